"""The analyses of runs by their names. Those with a picture bring matplotlib, so they are imported when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tsbench.core.extras import load
from tsbench.report.analyses.analysis import Analysis
from tsbench.report.analyses.main_table import floor, main_table, per_type
from tsbench.report.analyses.run_pool import RunPool, read_pool


def _later(module: str, name: str) -> Callable[..., Analysis]:
    """An analysis whose module is imported when it is asked for."""
    return lambda *given: getattr(load(f"tsbench.report.analyses.{module}"), name)(*given)


OF_POOL: Mapping[str, Callable[[RunPool], Analysis]] = {
    "main": lambda pool: main_table(pool.summaries, pool.title("Main table"), pool.contract, pool.contract),
    "types": lambda pool: per_type(pool.summaries, pool.title("SCD by type"), pool.contract),
    "intervals": _later("scd_intervals", "intervals"),
    "failures": _later("failures", "failures"),
    "correlations": _later("correlations", "correlations"),
    "floor": floor,
}
_OF_RUNS = {"ablation": _later("ablation", "ablation"), "perception": _later("perception_levels", "perception")}


def analyse_runs(name: str, paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """The analysis `name` of stored runs. Raises InputError for runs that cannot be analysed together."""
    if name in _OF_RUNS:
        return _OF_RUNS[name](paths, allow_partial)
    return OF_POOL[name](read_pool(paths, allow_partial))
