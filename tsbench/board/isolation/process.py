"""The referee's end of the line: an isolated planner's process, and the planner that the rest of a run sees."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from tsbench.board.isolation import protocol
from tsbench.board.isolation.episode_messages import Encoder, read_command
from tsbench.board.isolation.image import Container
from tsbench.board.isolation.protocol import ProtocolError
from tsbench.board.isolation.sandbox import Sandbox
from tsbench.board.isolation.sandbox_contents import PlannerFiles
from tsbench.core.errors import InputError, PlannerOutputError
from tsbench.core.machine import cause_of_end
from tsbench.core.text import fault_in_texts, one_line, written_out
from tsbench.planners.base import Control, PlannerContext, Trajectory
from tsbench.planners.observation import Observation
from tsbench.planners.planner_spec import PlannerSpec

_READ_BYTES = 1 << 16
_LAST_S = 5.0
# Between two episodes: long before its processor time is used up.
_MOST_EPISODES = 500
_TEXT_BYTES = 500
# Wall-clock limits. A worker of a run is ended long before (`execution.messages.Limits`); others have no watcher.
_START_S, _ANSWER_S = 600.0, 300.0


class IsolatedPlannerError(Exception):
    """What an isolated planner raised, or how its process ended."""


def _with_place(problem: str) -> str:
    """Why a planner's process came up with no planner, and what to do where it lacks a package that this one finds."""
    lacking = re.search(r"(?:No module named '|there is no module )(\w+)", problem)
    found = lacking and find_spec(lacking[1])
    if not found or not found.origin:
        return problem
    return (
        f"{problem.partition('; to install it')[0]}; a sandbox shows what pip has installed and the planner's own "
        f"files, not {Path(found.origin).parent}: install it with pip, or copy it beside the planner's file"
    )


class PlannerProcess:
    """A planner's process in its sandbox. effects: what the sandbox restricts; facts: what the planner says it is."""

    def __init__(
        self, spec: str, hidden: Sequence[Path] = (), files: PlannerFiles | None = None, *, show: bool = True
    ) -> None:
        """files: copies that other processes of the planner have, too; None: copies of its own.

        show: what it prints as text on standard error. A worker, whose log takes what it prints, does not.

        Raises InputError where it does not come up, with the planner's own reason.
        """
        planner = PlannerSpec.parse(spec)
        # A sandbox shows the copies for as long as they are there.
        self._shown = shown = files or PlannerFiles(planner.text, hidden)
        self._own_files = files is None
        self._printed = Printed() if show else None
        output = self._printed.end if self._printed else None
        try:
            self._held: Sandbox | Container = (
                Sandbox(spec, hidden, shown, output)
                if planner.image is None
                else Container(planner.image, planner.text, shown, output)
            )
        finally:
            if self._printed:
                self._printed.close_end()
        self.effects: Mapping[str, Any] = self._held.effects
        self._line = self._held.line
        self._patience = _START_S
        self._line.settimeout(self._patience)
        self._heard = b""
        try:
            self.facts = self._hello()
            if self.facts.protocol != protocol.VERSION:
                told = self.facts.protocol
                raise InputError(f"planner {spec!r}: speaks protocol {told}, this tsbench {protocol.VERSION}")
            if self.facts.problem:
                problem = one_line(self.facts.problem)
                raise InputError(problem if planner.image else _with_place(problem))
        except (IsolatedPlannerError, ProtocolError) as problem:
            self.close()
            raise InputError(f"planner {spec!r}: does not come up isolated: {problem}") from None
        except InputError:
            self.close()
            raise
        self._patience = _ANSWER_S
        self._line.settimeout(self._patience)

    def ask(self, request: bytes) -> protocol.Answer:
        """Its answer. Raises IsolatedPlannerError where it ends, ProtocolError for what is no answer."""
        try:
            self._line.sendall(request)
        except TimeoutError:
            raise self._silent() from None
        except OSError:
            raise IsolatedPlannerError(self._end()) from None
        answer = self._message()
        if self._heard:
            raise ProtocolError("more than one answer")
        return answer

    def _message(self) -> protocol.Answer:
        heard, end = self._heard, time.monotonic() + self._patience
        while len(heard) < protocol.HEAD.size:
            heard += self._more(end)
        (size,) = protocol.HEAD.unpack_from(heard)
        if size > protocol.MOST_BYTES:
            raise ProtocolError(f"a message of {size} bytes, at most {protocol.MOST_BYTES} are allowed")
        whole = protocol.HEAD.size + size
        while len(heard) < whole:
            heard += self._more(end)
        self._heard = heard[whole:]
        return protocol.read_answer(heard[protocol.HEAD.size : whole])

    def _more(self, end: float) -> bytes:
        """The next bytes; end: until when the whole message has to be here."""
        if time.monotonic() > end:
            raise self._silent()
        try:
            piece = self._line.recv(_READ_BYTES)
        except TimeoutError:
            raise self._silent() from None
        except OSError:
            piece = b""
        if not piece:
            raise IsolatedPlannerError(self._end())
        return piece

    def _silent(self) -> IsolatedPlannerError:
        return IsolatedPlannerError(f"the planner has not answered within {self._patience:.0f} s")

    def _hello(self) -> protocol.HelloMessage:
        told = self._message()
        if not isinstance(told, protocol.HelloMessage):
            raise ProtocolError(f"{type(told).__name__} where HelloMessage belongs")
        if fault := fault_in_texts([told.name, told.weights_file, told.problem]):
            raise ProtocolError(f"HelloMessage: {fault}")
        return told

    def _end(self) -> str:
        try:
            status = self._held.process.wait(_LAST_S)
        except subprocess.TimeoutExpired:
            return "the planner closed its line to the referee"
        return f"the planner's process ended: {cause_of_end(128 - status if status > 128 else status)}"

    def close(self) -> None:
        """End it and all that it has started."""
        self._line.close()
        self._held.close()
        if self._printed:
            self._printed.wait()
        if self._own_files:
            self._shown.remove()


class _NoNumber:
    """Stands for an answer that is no command: reading it raises the reason."""

    def __init__(self, reason: str) -> None:
        self._reason = reason

    def __float__(self) -> float:
        raise PlannerOutputError(self._reason)


class IsolatedPlanner:
    """A planner for the runner: each call is a message to the process, which is made when first needed.

    own: part of this package, and known to begin each episode afresh. alone: each episode has a new process. keeps: the
    run knows it as one that keeps its process. Any other has a new one for each episode, unless it forks for each.
    """

    def __init__(
        self, make: Callable[[], PlannerProcess], *, own: bool = False, alone: bool = False, keeps: bool = False
    ) -> None:
        self._make, self._own, self._alone, self._keeps = make, own, alone, keeps
        self._process: PlannerProcess | None = None
        self._encoder = Encoder()
        self._episodes = 0

    def reset(self, context: PlannerContext) -> None:
        self._end_episode()
        if self._process is None:
            self._process, self._encoder, self._episodes = self._make(), Encoder(), 0
        self._episodes += 1
        answer = self._ask(self._encoder.context(context))
        if not isinstance(answer, protocol.DoneMessage):
            self.close()
            raise PlannerOutputError(f"no message of the protocol: {type(answer).__name__} to a context")

    def _end_episode(self) -> None:
        """What the last episode left is gone after this, and with it the process where that takes its end."""
        if self._process is None:
            return
        facts, alone = self._process.facts, self._alone or self._episodes >= _MOST_EPISODES
        # What it says now may be another word than the run's.
        if not alone and (self._own or (self._keeps and facts.keeps_process)):
            return
        if not alone and facts.forks:
            # Whatever goes wrong belongs to no episode: the next one begins with a new process.
            with suppress(IsolatedPlannerError, PlannerOutputError):
                if isinstance(self._ask(protocol.frame(protocol.EndMessage())), protocol.DoneMessage):
                    return
            # A planner that could have its sandbox replaced, or not, would tell the next episode something by that.
            self._alone = True
        self.close()

    def act(self, observation: Observation) -> Control | Trajectory:
        try:
            return read_command(self._ask(self._encoder.observation(observation)))
        except ProtocolError as problem:
            self.close()
            return Control(_NoNumber(f"no message of the protocol: {problem}"), 0.0)  # type: ignore[arg-type]
        except PlannerOutputError as problem:
            return Control(_NoNumber(str(problem)), 0.0)  # type: ignore[arg-type]

    def _ask(self, request: bytes) -> protocol.Answer:
        if self._process is None:
            raise IsolatedPlannerError("the planner's process has ended")
        try:
            answer = self._process.ask(request)
            if isinstance(answer, protocol.FailedMessage):
                reason = one_line(answer.reason)[:_TEXT_BYTES]
                raise IsolatedPlannerError(reason) from IsolatedPlannerError(answer.detail)
        except ProtocolError as problem:
            self.close()
            raise PlannerOutputError(f"no message of the protocol: {problem}") from None
        except IsolatedPlannerError as problem:
            if problem.__cause__ is None:
                self.close()
            raise
        return answer

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None


# Of what a process prints; more is read and dropped.
_MOST_BYTES: Final = 100_000


class Printed:
    """end: a descriptor for a program to print to. Its lines go to this process's standard error, as text."""

    def __init__(self) -> None:
        self._start, self.end = os.pipe()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def close_end(self) -> None:
        """Once programs have it: it ends when they do."""
        os.close(self.end)

    def _read(self) -> None:
        left = _MOST_BYTES
        with os.fdopen(self._start, "rb", buffering=0) as file:
            held = b""
            while piece := file.read(1 << 16):
                held = (held + piece)[: left + 1]
                *lines, held = held.split(b"\n")
                for line in lines:
                    left -= len(line) + 1
                    _show(line)
                if left < len(held):
                    _show(b"(what the planner prints from here on is not shown)")
                    while file.read(1 << 16):
                        pass
                    return
            if held:
                _show(held)

    def wait(self) -> None:
        """Until all that had the end have ended, and everything is shown; for a few seconds at most."""
        self._reader.join(_LAST_S)


def _show(line: bytes) -> None:
    print(written_out(line.decode(errors="replace")), file=sys.stderr, flush=True)
