"""When a worker is ended, and whose fault its end is."""

from __future__ import annotations

import time
from dataclasses import dataclass

from tsbench.core.machine import cause_of_end, processor_s, resident_below_mb, resident_mb
from tsbench.episode.outcome import Outcome, Phase
from tsbench.run.execution.executor import Limits
from tsbench.run.execution.task_queue import Task
from tsbench.run.execution.worker_process import WorkerProcess
from tsbench.run.log.record import Record, error_row, lost_timing
from tsbench.run.planner_info import PlannerInfo

# A worker that has been silent for as long is looked at more closely.
_SILENT_S = 1.0


@dataclass(frozen=True)
class Overrun:
    """A limit that a worker has gone over. late: one of time, else of memory. text: which, for records."""

    late: bool
    text: str


def find_overrun(worker: WorkerProcess, limits: Limits, now: float) -> Overrun | None:
    """Has a worker that is at work gone over a limit? now: monotonic time, s; takes note of its heartbeat."""
    if resident_mb(worker.pid) + resident_below_mb(worker.pid) > limits.most_memory:
        text = f"the planner's worker took more than {limits.most_memory:g} MB of memory (--memory-limit)"
        return Overrun(False, text)
    if worker.heartbeat.stamp != worker.stamp:
        worker.stamp, worker.changed, worker.spent = worker.heartbeat.stamp, now, None
    silent, spent = now - worker.changed, 0.0
    if silent > _SILENT_S:
        used = processor_s(worker.heartbeat.player or worker.pid)
        worker.spent = used if worker.spent is None else worker.spent
        spent = used - worker.spent
    limit, phase = _limit(worker, limits), worker.heartbeat.phase
    if silent <= limit * limits.patience and spent <= limit:
        return None
    where = "one call of the planner" if phase is Phase.PLANNING else f"one step {phase.words}"
    # One text for both, so that a row does not say how busy the machine was.
    text = f"{where} took more than {limit:g} s of processor time, or {limit * limits.patience:g} s in all"
    return Overrun(True, text)


def _limit(worker: WorkerProcess, limits: Limits) -> float:
    if not worker.held:
        return limits.start
    if worker.heartbeat.phase is not Phase.PLANNING:
        return limits.phase
    return limits.first_call if worker.heartbeat.planner_calls <= 2 else limits.call


def lost_record(worker: WorkerProcess, task: Task, who: PlannerInfo, status: int, overrun: Overrun | None) -> Record:
    """The record of an episode that took its worker along. who: its planner; status: how the worker ended."""
    phase = worker.heartbeat.phase
    ours = phase not in (Phase.PLANNING, Phase.IDLE)
    outcome = Outcome.PLANNER_ERROR
    if overrun is not None:
        error = overrun.text
        if overrun.late:
            outcome = Outcome.SIM_ERROR if ours else Outcome.PLANNER_TIMEOUT
    elif worker.broken or phase is Phase.IDLE:
        # Nothing of ours closes the line, or ends without an answer once the episode is over.
        error = "the planner has closed or used the line between its worker and the run"
    else:
        error = f"the worker process ended {phase.words}: {cause_of_end(status)}"
        # Nothing of ours ends a process by an exit code.
        if ours and status < 0:
            outcome = Outcome.SIM_ERROR
    row = error_row(task.spec, who.name, who.privileged, outcome, error)
    detail = f"{error}\n\nOutput of the worker\n{worker.tail_text() or '  (none)'}\n"
    timing = lost_timing(task.spec, who.name, time.monotonic() - worker.changed)
    return Record(row, [], timing, detail)
