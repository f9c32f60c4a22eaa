"""The inference process: answers the networks of batched planners for all workers. Started by `inference_client` only.

python -m tsbench.run.execution.inference_server LISTENING_FD PARENT_PID DEVICE

A worker connects, names its planner, and then sends records and gets records, as bytes of the planner's dtypes. Every
answer begins with `FINE` or, before a line of text, with `PROBLEM`.
What has arrived while a batch was worked on makes the next batch: nobody waits for a clock.
"""

from __future__ import annotations

import socket
import sys
import traceback
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np

from tsbench.core.errors import InputError
from tsbench.core.machine import die_with
from tsbench.planners.common.batching import Infer
from tsbench.planners.registry import resolve

FINE, PROBLEM = b"+", b"-"
# Larger batches gain little more, and the first to ask waits for the last.
_MOST = 16


class ModelServer:
    """One planner's network and the workers that ask it."""

    def __init__(self, spec: str, device: str) -> None:
        planner = resolve(spec).batched
        if planner is None:
            raise InputError(f"planner {spec!r}: has no network that could be served")
        self._spec = spec
        self.inputs: np.dtype[Any] = planner.inputs
        self._infer: Infer = planner.network(device)

    def answer(self, asked: list[tuple[Connection, bytes]]) -> None:
        """Answer requests of one record each, in batches."""
        for first in range(0, len(asked), _MOST):
            some = asked[first : first + _MOST]
            for (connection, _), answer in zip(
                some, self._batch([request for _, request in some]), strict=True
            ):
                _send(connection, answer)

    def _batch(self, requests: list[bytes]) -> list[bytes]:
        """One answer each: a request that the network breaks on costs none of the others theirs."""
        try:
            records = np.frombuffer(b"".join(requests), dtype=self.inputs)
            answers = self._infer(records)
            return [FINE + answers[k].tobytes() for k in range(len(requests))]
        except Exception as problem:
            # Somebody else's code: the episode that asked ends as an error with this cause.
            if len(requests) > 1:
                return [self._batch([request])[0] for request in requests]
            traceback.print_exc()
            return [
                PROBLEM
                + f"planner {self._spec!r}: its network broke: {type(problem).__name__}: {problem}".encode()
            ]


class Server:
    """Takes connections and batches what they ask."""

    def __init__(self, listener: socket.socket, device: str) -> None:
        self._listener, self._device = listener, device
        self._models: dict[str, ModelServer] = {}
        self._planners: dict[Connection, str | None] = {}

    def serve(self) -> None:
        """For ever: it ends with its parent."""
        while True:
            asked: dict[str, list[tuple[Connection, bytes]]] = {}
            for ready in wait([self._listener, *self._planners]):
                if ready is self._listener:
                    self._planners[Connection(self._listener.accept()[0].detach())] = None
                    continue
                assert isinstance(ready, Connection)
                self._receive(ready, asked)
            for spec, requests in asked.items():
                self._models[spec].answer(requests)

    def _receive(self, connection: Connection, asked: dict[str, list[tuple[Connection, bytes]]]) -> None:
        try:
            message = connection.recv_bytes()
        except (EOFError, OSError):
            # A worker has ended, or was ended.
            del self._planners[connection]
            connection.close()
            return
        spec = self._planners[connection]
        if spec is not None:
            asked.setdefault(spec, []).append((connection, message))
            return
        self._planners[connection] = spec = message.decode()
        problem = self._open(spec)
        _send(connection, PROBLEM + problem.encode() if problem else FINE)

    def _open(self, spec: str) -> str:
        """Load a planner's network, if it is not yet; returns why that is impossible, or ""."""
        try:
            if spec not in self._models:
                self._models[spec] = ModelServer(spec, self._device)
        except InputError as problem:
            return str(problem)
        except Exception as problem:
            # Somebody else's code: its episodes end as errors with this cause, ours go on.
            traceback.print_exc()
            return f"planner {spec!r}: its network does not load: {type(problem).__name__}: {problem}"
        return ""


def _send(connection: Connection, content: bytes) -> None:
    try:
        connection.send_bytes(content)
    except (BrokenPipeError, ConnectionResetError):
        # A worker that has ended meanwhile; the next look at its line says so too.
        return


def main(arguments: list[str]) -> None:
    listening_fd, parent, device = int(arguments[0]), int(arguments[1]), arguments[2]
    die_with(parent)
    Server(socket.socket(fileno=listening_fd), device).serve()


if __name__ == "__main__":
    main(sys.argv[1:])
