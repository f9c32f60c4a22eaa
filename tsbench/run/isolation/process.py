"""The referee's end of the line: an isolated planner's process, and the planner that the rest of a run sees."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tsbench.core.errors import InputError, PlannerOutputError
from tsbench.core.text import one_line
from tsbench.planners.base import Control, Observation, PlannerContext, Trajectory
from tsbench.run.execution.child import cause_of_end
from tsbench.run.isolation.moments import Teller, read_command
from tsbench.run.isolation.places import EXECUTABLE, settings_of
from tsbench.run.isolation.protocol import HEAD, MOST_BYTES, VERSION, Kind, ProtocolError, unpack

_CELL = Path(__file__).with_name("cell.py")
_READ_BYTES = 1 << 16
_LAST_S = 5.0
# Between two episodes: long before its processor time is used up.
_MOST_EPISODES = 500
_TEXT_BYTES = 500


class IsolatedPlannerError(Exception):
    """What an isolated planner raised, or how its process ended."""


class PlannerProcess:
    """A planner's process in its cell. effects: what of the cell took effect; facts: what the planner says it is."""

    def __init__(self, spec: str, hidden: Sequence[Path] = ()) -> None:
        """Raises InputError where it does not come up, with the planner's own reason."""
        self._spec = spec
        self._folder = TemporaryDirectory(prefix="tsbench-cell-", ignore_cleanup_errors=True)
        root, home = (Path(self._folder.name) / name for name in ("root", "home"))
        root.mkdir()
        home.mkdir()
        self._line, far_end = socket.socketpair()
        settings = settings_of(spec, _command(spec), root, home, hidden)
        self._process = _start(far_end, settings)
        far_end.close()
        self._heard = b""
        try:
            self.effects: dict[str, Any] = self._json(Kind.CELL)
            if "problem" in self.effects:
                raise InputError(f"planner {spec!r}: no cell could be made: {self.effects['problem']}")
            self.facts: dict[str, Any] = self._json(Kind.HELLO)
            if self.facts.get("protocol") != VERSION:
                told = self.facts.get("protocol")
                raise InputError(f"planner {spec!r}: speaks protocol {told!r:.20}, this tsbench {VERSION}")
            if "problem" in self.facts:
                raise InputError(one_line(str(self.facts["problem"])))
        except (IsolatedPlannerError, ProtocolError) as problem:
            self.close()
            raise InputError(f"planner {spec!r}: does not come up isolated: {problem}") from None
        except InputError:
            self.close()
            raise

    def ask(self, request: bytes) -> tuple[Kind, bytes]:
        """Its answer. Raises IsolatedPlannerError where it ends, ProtocolError for what is no answer."""
        try:
            self._line.sendall(request)
        except OSError:
            raise IsolatedPlannerError(self._end()) from None
        kind, body = self._message()
        if self._heard:
            raise ProtocolError("more than one answer")
        return kind, body

    def _message(self) -> tuple[Kind, bytes]:
        heard = self._heard
        while len(heard) < HEAD.size:
            heard += self._more()
        size, number = HEAD.unpack_from(heard)
        if size > MOST_BYTES:
            raise ProtocolError(f"a message of {size} bytes, at most {MOST_BYTES} are allowed")
        end = HEAD.size + size
        while len(heard) < end:
            heard += self._more()
        self._heard = heard[end:]
        try:
            return Kind(number), heard[HEAD.size : end]
        except ValueError:
            raise ProtocolError(f"a message of kind {number}, which there is not") from None

    def _more(self) -> bytes:
        try:
            piece = self._line.recv(_READ_BYTES)
        except OSError:
            piece = b""
        if not piece:
            raise IsolatedPlannerError(self._end())
        return piece

    def _json(self, wanted: Kind) -> dict[str, Any]:
        kind, body = self._message()
        if kind is not wanted:
            raise ProtocolError(f"{kind.name} where {wanted.name} belongs")
        try:
            told = json.loads(unpack(kind, body)[0])
        except (ValueError, RecursionError):
            told = None
        if not isinstance(told, dict):
            raise ProtocolError(f"{wanted.name} is no JSON object")
        return told

    def _end(self) -> str:
        try:
            status = self._process.wait(_LAST_S)
        except subprocess.TimeoutExpired:
            return "the planner closed its line to the referee"
        return f"the planner's process ended: {cause_of_end(128 - status if status > 128 else status)}"

    def close(self) -> None:
        """End it and all that it has started."""
        self._line.close()
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            self._folder.cleanup()


def _command(spec: str) -> list[str]:
    if spec.startswith(EXECUTABLE):
        path = Path(spec.removeprefix(EXECUTABLE)).resolve()
        if not (path.is_file() and os.access(path, os.X_OK)):
            raise InputError(f"planner {spec!r}: {path} is no file that can be executed")
        return [str(path)]
    return [sys.executable, "-P", "-m", "tsbench.run.isolation.client", _absolute(spec)]


def _absolute(spec: str) -> str:
    """The same for who stands in another folder."""
    source, _, attribute = spec.rpartition(":")
    return f"{Path(source).resolve()}:{attribute}" if source.endswith(".py") else spec


def _start(far_end: socket.socket, settings: dict[str, Any]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-I", "-S", str(_CELL), str(far_end.fileno()), json.dumps(settings)],
        stdin=subprocess.DEVNULL, pass_fds=(far_end.fileno(),), env={"LANG": "C.UTF-8"},
    )  # fmt: skip


class _NoNumber:
    """Stands for an answer that is no command: whoever reads it is told why, as of any other planner's."""

    def __init__(self, reason: str) -> None:
        self._reason = reason

    def __float__(self) -> float:
        raise PlannerOutputError(self._reason)


class IsolatedPlanner:
    """A planner for the runner: each call is a message to the process, which is made when first needed."""

    def __init__(self, make: Callable[[], PlannerProcess]) -> None:
        self._make = make
        self._process: PlannerProcess | None = None
        self._teller = Teller()
        self._episodes = 0

    def reset(self, context: PlannerContext) -> None:
        if self._episodes >= _MOST_EPISODES:
            self.close()
        if self._process is None:
            self._process, self._teller, self._episodes = self._make(), Teller(), 0
        self._episodes += 1
        kind, body = self._ask(self._teller.context(context))
        if kind is not Kind.DONE or body:
            self.close()
            raise PlannerOutputError(f"no message of the protocol: {kind.name} to a context")

    def act(self, observation: Observation) -> Control | Trajectory:
        try:
            kind, body = self._ask(self._teller.observation(observation))
            return read_command(kind, body)
        except ProtocolError as problem:
            self.close()
            return Control(_NoNumber(f"no message of the protocol: {problem}"), 0.0)  # type: ignore[arg-type]
        except PlannerOutputError as problem:
            return Control(_NoNumber(str(problem)), 0.0)  # type: ignore[arg-type]

    def _ask(self, request: bytes) -> tuple[Kind, bytes]:
        if self._process is None:
            raise IsolatedPlannerError("the planner's process has ended")
        try:
            kind, body = self._process.ask(request)
            if kind is Kind.FAILED:
                reason, detail = unpack(kind, body)
                raise IsolatedPlannerError(one_line(reason)[:_TEXT_BYTES]) from IsolatedPlannerError(detail)
        except ProtocolError as problem:
            self.close()
            raise PlannerOutputError(f"no message of the protocol: {problem}") from None
        except IsolatedPlannerError as problem:
            if problem.__cause__ is None:
                self.close()
            raise
        return kind, body

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None
