"""One worker process as its parent sees it: started, spoken to, watched, ended."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from multiprocessing import Pipe
from typing import Any

from tsbench.run.handout import Task
from tsbench.run.memory import MemoryUse
from tsbench.run.pulse import Pulse, pulse_file

Message = dict[str, Any]

TAIL_BYTES = 1 << 16
_READ_BYTES = 1 << 18
_LAST_READS = 8
_LAST_GASP_MS = 2000
# One simulation is one thread; maths libraries that start one thread per core only get in each other's way, and how
# many there are decides how their sums are rounded.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "ARROW_IO_THREADS"),
    "1",
)


@dataclass(frozen=True)
class Setup:
    """What all workers of a run are told.

    runner: module:Class of the episode runner. planners: what `contestant.describe` says of each, in order.
    out: the run folder, for traces. trace: none, violations, all. split, contract: what a worker on another machine
    must have too. inference: where the inference process listens, "" = each worker has networks of its own.
    recorder: module:function from an episode's result to its record. options: what else the runner is made with.
    """

    runner: str
    planners: tuple[Mapping[str, Any], ...]
    mask_signs: bool
    device: str
    trace: str
    out: str
    split: str
    contract: str
    inference: str = ""
    recorder: str = "tsbench.run.score:make_record"
    options: Mapping[str, Any] = field(default_factory=dict)


class WorkerProcess:
    """A worker: its process, the line to it, its pulse, what it printed last, and the tasks that it holds.

    held: tasks sent and not answered, oldest first. changed: monotonic time at which its pulse was last seen
    to move; stamp: what it was then. ready: it has come up. closed: nothing more will come
    from it. answer: to the last probe. outgrown: it is too large to get another task.
    """

    def __init__(self, now: float) -> None:
        self.held: deque[Task] = deque()
        self.ready = self.closed = self.outgrown = False
        self.memory = MemoryUse()
        self.answer: Message | None = None
        self.changed = self.begun = now
        self.stamp = 0
        self.tail = bytearray()
        self.printed = 0
        pulse_fd = pulse_file()
        self.pulse = Pulse(pulse_fd)
        self.connection, far_end = Pipe(duplex=True)
        self.log_fd, log_write = os.pipe()
        os.set_blocking(self.log_fd, False)
        fds = (far_end.fileno(), pulse_fd)
        self.process = subprocess.Popen(
            # -P: no working directory in front of sys.path, where a stray json.py would be imported for ours.
            [sys.executable, "-P", "-u", "-m", "tsbench.run.worker_main", *map(str, fds), str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=log_write,
            stderr=log_write,
            pass_fds=fds,
            # A session of its own: Ctrl-C reaches the parent only, killing the group its children too.
            start_new_session=True,
            env={**os.environ, **ONE_THREAD, "PYTHONFAULTHANDLER": "1"},
        )
        os.close(log_write)
        os.close(pulse_fd)
        far_end.close()
        self.death_fd = os.pidfd_open(self.process.pid)
        self._send({"sys_path": sys.path})

    def configure(self, setup: Setup) -> None:
        """Tell it about the run; before its first task."""
        self._send({"do": "setup", "setup": asdict(setup)})

    def send_task(self, task: Task) -> None:
        """Hand over an episode; several may wait in the line."""
        if not self.held:
            self.drop_tail()
        self.held.append(task)
        self._send({"do": "episode", "task": task.number, "planner": task.planner, "spec": asdict(task.spec)})

    def send_probe(self, spec: str) -> None:
        """Ask what a planner is."""
        self._send({"do": "probe", "spec": spec})

    def _send(self, message: Message) -> None:
        try:
            self.connection.send_bytes(json.dumps(message).encode())
        except (BrokenPipeError, ConnectionResetError):
            # It is dead: its end is noticed where ends are noticed, and its tasks go to another.
            return

    def receive(self) -> list[Message]:
        """All messages that have arrived."""
        messages = []
        try:
            while self.connection.poll():
                messages.append(json.loads(self.connection.recv_bytes()))
        except (EOFError, OSError, ValueError):
            # It died, or a planner closed what was not its own, or wrote there.
            self.closed = True
        return messages

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
        if self.closed:
            # It is on its way out: its own exit status says more than ours would.
            death = select.poll()
            death.register(self.death_fd, select.POLLIN)
            death.poll(_LAST_GASP_MS)
        # The group is signalled before its leader is reaped: until then its number is nobody else's.
        os.killpg(self.process.pid, signal.SIGKILL)
        status = self.process.wait()
        for _ in range(_LAST_READS):
            if not self.read_log():
                break
        os.close(self.log_fd)
        os.close(self.death_fd)
        self.connection.close()
        return status

    def leave(self) -> None:
        """Ask it to end by itself: it does when the line closes."""
        self.connection.close()


def cause_of_end(status: int) -> str:
    """An exit status in words."""
    if status >= 0:
        return f"exit code {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"signal {-status}"
