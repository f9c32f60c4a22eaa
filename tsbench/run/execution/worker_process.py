"""One worker process as its parent sees it: started, spoken to, watched, ended, and whose fault its end is."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.core.machine import (
    ONE_THREAD,
    MemoryUse,
    cause_of_end,
    module_command,
    processor_s,
    resident_below_mb,
    resident_mb,
)
from tsbench.episode.outcome import Outcome, Phase
from tsbench.run.execution.messages import (
    TO_RUN,
    Heartbeat,
    Limits,
    Probe,
    Probed,
    Setup,
    Start,
    Task,
    decode,
    encode,
    heartbeat_file,
)
from tsbench.run.log.record import Record, error_row, lost_timing
from tsbench.run.planner_info import PlannerInfo

TAIL_BYTES = 1 << 16
_READ_BYTES = 1 << 18
# Far more than any answer has.
_MOST_BYTES = 1 << 27
_LAST_READS = 8
_LAST_GASP_S = 5.0
_SHUTDOWN_TIMEOUT_S = 10.0
_REAPER = Path(__file__).with_name("reaper.py")
# A hard bound on what a process may ask for at once, so that it cannot outrun the memory watchdog.
_DATA_BYTES_PER_MB = 2_000_000


class WorkerProcess:
    """A worker: its process, the line to it, its heartbeat, what it printed last, and the tasks that it holds.

    process: its reaper, which ends as it does and takes along all that it has started; pid: its own, 0 until it has
    come up. planner: spec of the only planner that it has met, "" = none yet. held: tasks sent and not answered,
    oldest first. changed: monotonic time at which its heartbeat was last seen to move; stamp: what it was then; spent:
    processor time that it had used soon after, None = not looked at yet. ready: it has come up. closed_at: when its
    line was closed. closed: nothing more will come from it; broken: though it had not ended. answer: to the last probe.
    outgrown: it is too large to get another task.
    """

    def __init__(self, now: float, most_mb: float) -> None:
        self.held: deque[Task] = deque()
        self.ready = self.closed = self.broken = self.outgrown = False
        self.memory = MemoryUse()
        self.answer: Probed | None = None
        self.planner = ""
        self.pid = 0
        self.changed = now
        self.spent: float | None = None
        self.closed_at: float | None = None
        self.stamp = 0
        self.tail = bytearray()
        self.printed = 0
        heartbeat_fd = heartbeat_file()
        self.heartbeat = Heartbeat(heartbeat_fd)
        self.connection, far_end = socket.socketpair()
        self._heard = bytearray()
        self.log_fd, log_write = os.pipe()
        os.set_blocking(self.log_fd, False)
        fds = (far_end.fileno(), heartbeat_fd)
        reaper = [sys.executable, "-I", "-S", str(_REAPER), str(os.getpid())]
        reaper.append(str(int(most_mb * _DATA_BYTES_PER_MB)))
        self.process = subprocess.Popen(
            # -P: no working directory in front of sys.path, where a stray json.py would be imported for ours.
            [*reaper, *module_command("tsbench.run.execution.worker_main"), *map(str, fds)],
            stdin=subprocess.DEVNULL,
            stdout=log_write,
            stderr=log_write,
            pass_fds=fds,
            # A session of its own: Ctrl-C reaches the parent only.
            start_new_session=True,
            env={**os.environ, **ONE_THREAD, "PYTHONFAULTHANDLER": "1"},
        )
        os.close(log_write)
        os.close(heartbeat_fd)
        far_end.close()
        self.death_fd = os.pidfd_open(self.process.pid)
        self._send(Start(tuple(sys.path)))

    def configure(self, setup: Setup) -> None:
        self._send(setup)

    def send_task(self, task: Task) -> None:
        """Hand over an episode; several may wait in the line."""
        if not self.held:
            self.drop_tail()
        self.held.append(task)
        self._send(task)

    def send_probe(self, spec: str, device: str) -> None:
        self.planner = spec
        self._send(Probe(spec, device))

    def _send(self, message: Any) -> None:
        try:
            self.connection.sendall(encode(message))
        except (BrokenPipeError, ConnectionResetError):
            # It is dead: its end is noticed where ends are noticed, and its tasks go to another.
            return

    def receive(self) -> list[Any]:
        """All messages that have arrived (of `TO_RUN`); whatever a planner writes there, this never waits."""
        messages: list[Any] = []
        try:
            while piece := self.connection.recv(_READ_BYTES, socket.MSG_DONTWAIT):
                *lines, rest = piece.split(b"\n")
                for line in lines:
                    messages.append(decode(bytes(self._heard + line), TO_RUN))
                    self._heard.clear()
                self._heard += rest
                if len(self._heard) > _MOST_BYTES:
                    raise ValueError("no message of a worker")
            self.closed_at = self.closed_at or time.monotonic()
        except BlockingIOError:
            pass
        except ConnectionResetError:
            self.closed_at = self.closed_at or time.monotonic()
        except (ValueError, RecursionError):
            # A planner wrote there.
            self.closed = self.broken = True
        return messages

    def give_up(self, now: float) -> None:
        """Its line was closed, and it has not ended: a planner closed what was not its own."""
        if self.closed_at is not None and now - self.closed_at > _LAST_GASP_S:
            self.closed = self.broken = True

    def read_log(self) -> bool:
        """Take what it printed, keep the tail; False once nothing more can come."""
        try:
            piece = os.read(self.log_fd, _READ_BYTES)
        except BlockingIOError:
            return True
        self.tail += piece
        self.printed += len(piece)
        del self.tail[:-TAIL_BYTES]
        return bool(piece)

    def drop_tail(self) -> None:
        """Forget what it printed: it belongs to an episode that is over."""
        self.tail.clear()
        self.printed = 0

    def tail_text(self) -> str:
        """What it printed last, "" if nothing."""
        lines = self.tail.decode(errors="replace").strip().splitlines()
        # faulthandler's list of all loaded modules is long and says nothing.
        text = "\n".join(line for line in lines if not line.startswith("Extension modules:"))
        cut = f"({self.printed} bytes printed, the last {len(self.tail)} follow)\n"
        return (cut if self.printed > len(self.tail) else "") + text

    def end(self) -> int:
        """Kill it with everything that it started, and return its exit status (negative: a signal)."""
        self.process.terminate()
        try:
            status = self.process.wait(_SHUTDOWN_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            # Stopped by its own child, for one: the worker still dies with it.
            self.process.kill()
            status = self.process.wait()
        for _ in range(_LAST_READS):
            if not self.read_log():
                break
        os.close(self.log_fd)
        os.close(self.death_fd)
        self.connection.close()
        return status

    def shutdown(self) -> None:
        """Ask it to end by itself: it does when the line closes."""
        self.connection.close()


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
