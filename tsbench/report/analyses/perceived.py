"""What wrong perception did in failed signed episodes: the cause of each, from what its trace says was told."""

from __future__ import annotations

from tsbench.core.errors import InputError
from tsbench.episode.perception import FALSE, MISREAD, RIGHT
from tsbench.episode.trace import Trace, read_trace, trace_path
from tsbench.report.analyses.pool import RunPool

MISSED, MISREAD_AS, LATE, FALSE_PLATE = "missed", "misread", "late", "false"
CAUSES = (MISSED, MISREAD_AS, LATE, FALSE_PLATE)
# Braking (m/s2) that stopping at the plate would have taken when it was told.
_LATE_MPS2 = 3.0
CAUSE_NOTES = (
    "failed signed halves by the first that applies: misread: the target plate was told as another; missed: it was "
    "never told right; late: when it was told, stopping at it took more than 3 m/s2, or a rule was broken already; "
    "false: a plate that is not there was told. Empty: exact perception, or no traces kept. The rest read it in time",
)


def causes_of(pool: RunPool, planner: str) -> list[str] | None:
    """The cause of each failed signed episode, "" where perception was not it; None where nothing says that.

    An error outcome has none.
    """
    run = pool.home[planner]
    effective = run.manifest["effective"]
    if "perception" not in effective or effective["trace"] == "none":
        return None
    failed, causes = pool.failed_signed(planner), []
    # Where a run is kept without its traces.
    if failed and not (run.path / "traces").is_dir():
        return None
    for scenario in failed:
        path = trace_path(run.path, planner, scenario)
        try:
            causes.append(cause_of_failure(read_trace(path)))
        except InputError as problem:
            raise InputError(
                f"{problem}: traces say what was told (tsbench run --trace violations)"
            ) from None
    return causes


def cause_of_failure(trace: Trace) -> str:
    """One of CAUSES, or ""."""
    target = [told for told in trace.told if told.role == "target"]
    if any(told.kind == MISREAD for told in target):
        return MISREAD_AS
    right = [told for told in target if told.kind == RIGHT]
    if not right:
        return MISSED
    first = right[0]
    begun = min((event.start_s for event in trace.events), default=float("inf"))
    if begun <= trace.snapshots[first.step].time or first.speed**2 > 2.0 * _LATE_MPS2 * max(
        first.ahead_m, 0.0
    ):
        return LATE
    return FALSE_PLATE if any(told.kind == FALSE for told in trace.told) else ""
