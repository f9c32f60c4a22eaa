"""The analyses of runs by their names. Those with a picture bring matplotlib, so they are imported when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tsbench.report.analyses.analysis import Analysis
from tsbench.report.analyses.main_table import floor, main_table, per_type
from tsbench.report.analyses.run_pool import RunPool, read_pool


def _intervals(pool: RunPool) -> Analysis:
    from tsbench.report.analyses.scd_intervals import intervals

    return intervals(pool)


def _failures(pool: RunPool) -> Analysis:
    from tsbench.report.analyses.failures import failures

    return failures(pool)


def _correlations(pool: RunPool) -> Analysis:
    from tsbench.report.analyses.correlations import correlations

    return correlations(pool)


OF_POOL: Mapping[str, Callable[[RunPool], Analysis]] = {
    "main": lambda pool: main_table(pool.summaries, pool.title("Main table"), pool.contract, pool.contract),
    "types": lambda pool: per_type(pool.summaries, pool.title("SCD by type"), pool.contract),
    "intervals": _intervals,
    "failures": _failures,
    "correlations": _correlations,
    "floor": floor,
}


def analyse_runs(name: str, paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """The analysis `name` of stored runs. Raises InputError for runs that cannot be analysed together."""
    if name == "ablation":
        from tsbench.report.analyses.ablation import ablation

        return ablation(paths, allow_partial)
    if name == "perception":
        from tsbench.report.analyses.perception_levels import perception

        return perception(paths, allow_partial)
    return OF_POOL[name](read_pool(paths, allow_partial))
