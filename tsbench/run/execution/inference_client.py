"""Both ends of the inference process: the parent that starts it, and the workers' planners that ask it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tsbench.core.errors import InputError
from tsbench.planners.common.batching import Records
from tsbench.run.execution.child import ONE_THREAD
from tsbench.run.execution.inference_server import PROBLEM

_SERVER = "tsbench.run.execution.inference_server"
_DEATHS = 3


class InferenceServer:
    """The inference process of a run, started again where it has died. address: where workers find it."""

    def __init__(self, device: str) -> None:
        self._folder = TemporaryDirectory(prefix="tsbench-inference-")
        self._device = device
        self.address = str(Path(self._folder.name) / "line")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(self.address)
        self._listener.listen(256)
        self._log = Path(self._folder.name) / "log"
        self._deaths = 0
        self._process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        fd = self._listener.fileno()
        with self._log.open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-P", "-m", _SERVER, str(fd), str(os.getpid()), self._device],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, pass_fds=(fd,), start_new_session=True,
                env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(sys.path)},
            )  # fmt: skip

    def revive(self) -> None:
        """Start it again if it has ended. Raises InputError where that keeps happening."""
        if self._process.poll() is None:
            return
        self._deaths += 1
        if self._deaths >= _DEATHS:
            said = self._log.read_text(errors="replace").strip().splitlines() or ["it said nothing"]
            raise InputError(f"the inference process has ended {self._deaths} times: {said[-1]}")
        self._process = self._start()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._listener.close()
        self._folder.cleanup()


class InferenceClient:
    """A worker's line to the inference process, for one planner: an `Infer`."""

    def __init__(self, address: str, spec: str, outputs: np.dtype[Any]) -> None:
        """Raises InputError where the network cannot be loaded there."""
        self._outputs = outputs
        there = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        there.connect(address)
        self._connection = Connection(there.detach())
        self._ask(spec.encode())

    def __call__(self, records: Records) -> Records:
        """(b,) answers to (b,) records. Raises InputError where the network breaks on one."""
        return np.array(
            [np.frombuffer(self._ask(r.tobytes()), self._outputs)[0] for r in records], self._outputs
        )

    def _ask(self, request: bytes) -> bytes:
        try:
            self._connection.send_bytes(request)
            answer = self._connection.recv_bytes()
        except (EOFError, OSError):
            # The inference process is gone, which is no fault of the planner: this worker ends as if it had been
            # ended from outside, and its episode is given to another.
            os.kill(os.getpid(), signal.SIGKILL)
            raise
        if answer[:1] == PROBLEM:
            raise InputError(answer[1:].decode())
        return answer[1:]
