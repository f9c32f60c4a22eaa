"""A Python planner at the far end of the line. Started by `process` only, in its sandbox.

python -P -m tsbench.board.isolation.client SPEC

The line is descriptor 3, or in a container the socket that TSBENCH_LINE names. This is the reference for clients: who
speaks so, in any language, is a planner.
"""

from __future__ import annotations

import os
import socket
import sys
import traceback
from contextlib import suppress
from typing import Any

from tsbench.board.isolation import protocol
from tsbench.board.isolation.episode_messages import Decoder, command_message
from tsbench.board.isolation.leavings import Leavings
from tsbench.core.errors import InputError, cause_in_planner
from tsbench.core.machine import adopt_orphans
from tsbench.core.text import written_out
from tsbench.planners.base import Planner, PlannerContext
from tsbench.planners.planner_spec import cause_with_place
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.execution.fresh_episode import end_as, run_in_child, shared_with_children

_ROOM_BYTES = 1 << 16
_LONGEST_TEXT = 100_000


class Client:
    """Hears what happens, and answers.

    leavings: of a planner whose episodes are each played by a child of this process, so that they begin in the state
    that its constructor left; None: this process plays them all.
    """

    def __init__(self, line: socket.socket, loaded: LoadedPlanner, planner: Planner, leavings: Leavings | None) -> None:
        self._line, self._loaded, self._leavings = line, loaded, leavings
        self._planner: Planner | None = planner
        self._decoder = Decoder()
        self._heard = os.fdopen(line.fileno(), "rb", _ROOM_BYTES, closefd=False)

    def serve(self) -> None:
        """Until the line is closed, or an episode has left something: the next needs a new sandbox."""
        while (message := self._message()) is not None:
            if self._leavings is not None and isinstance(message, protocol.ContextMessage):
                if not self._episode_in_child(message, self._leavings):
                    return
            else:
                self._hear(message)

    def _hear(self, message: protocol.Asked) -> None:
        asked = self._decoder.hear(message)
        if asked is not None:
            self._line.sendall(self._answer(asked))

    def _episode_in_child(self, context: protocol.ContextMessage, leavings: Leavings) -> bool:
        """One episode, up to its END, which is answered if nothing of it is left. Is nothing left?"""
        status = run_in_child(lambda: self._episode(context))
        if status is not None:
            end_as(status)
        if not leavings.nothing_left():
            return False
        # The referee may have gone.
        with suppress(OSError):
            self._line.sendall(protocol.frame(protocol.DoneMessage()))
        return True

    def _episode(self, context: protocol.ContextMessage) -> None:
        message: protocol.Asked | None = context
        while message is not None and not isinstance(message, protocol.EndMessage):
            self._hear(message)
            message = self._message()

    def _answer(self, asked: Any) -> bytes:
        try:
            # One that could not begin an episode is made anew, as in a process with the referee.
            if isinstance(asked, PlannerContext):
                if self._planner is None:
                    self._planner = self._loaded.factory()
                self._planner.reset(asked)
                return protocol.frame(protocol.DoneMessage())
            assert self._planner is not None
            output = self._planner.act(asked)
        except BaseException as problem:
            # Half a character, in what a planner says, is no reason to say nothing.
            detail = traceback.format_exc()[-_LONGEST_TEXT:].encode(errors="backslashreplace").decode()
            return protocol.frame(protocol.FailedMessage(cause_in_planner(problem)[:500], detail))
        return command_message(output)

    def _message(self) -> protocol.Asked | None:
        head = self._heard.read(protocol.HEAD.size)
        size = protocol.HEAD.unpack(head)[0] if len(head) == protocol.HEAD.size else 0
        body = self._heard.read(size)
        return self._decoder.read(body) if body and len(body) == size else None


def main(spec: str) -> None:
    line = _connected()
    try:
        adopt_orphans()
        before = shared_with_children()
        loaded = resolve(spec)
        planner = _made(loaded)
    except InputError as problem:
        line.sendall(protocol.frame(protocol.HelloMessage(protocol.VERSION, problem=written_out(str(problem)))))
        return
    forks = not (loaded.own or loaded.keeps_process or shared_with_children() - before)
    weights_file = loaded.weights.file if loaded.weights else None
    own = (loaded.name, loaded.privileged, loaded.sign_access, loaded.floor)
    facts = protocol.HelloMessage(protocol.VERSION, *own, weights_file, forks=forks, keeps_process=not forks)
    line.sendall(protocol.frame(facts))
    Client(line, loaded, planner, Leavings(line) if forks else None).serve()


def _connected() -> socket.socket:
    place = os.environ.pop("TSBENCH_LINE", "")
    if place:
        line = socket.socket(socket.AF_UNIX)
        line.connect(place)
        return line
    line = socket.socket(fileno=os.dup(protocol.LINE))
    os.close(protocol.LINE)
    return line


def _made(loaded: LoadedPlanner) -> Planner:
    try:
        return loaded.factory()
    except InputError:
        raise
    except BaseException as error:
        raise InputError(f"planner {loaded.spec!r}: cannot be made: {cause_with_place(error)}") from error


if __name__ == "__main__":
    main(sys.argv[1])
