"""Errors that users meet. Each message is one line that names what, where and what to do."""

from __future__ import annotations

import os
import traceback
from pathlib import Path

from tsbench.core.text import written_out

# Of Python and of tsbench.
_LIBRARIES = (Path(os.__file__).parent, Path(__file__).resolve().parents[1])


def cause_of(error: BaseException) -> str:
    """Kind and text of a foreign exception, on one line, fit for any file: its text may be no text at all."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = "(its text cannot be had)"
    return written_out(f"{type(error).__name__}: {text}")


def cause_in_planner(error: BaseException) -> str:
    """As `cause_of`, with the planner's own line that it came from, as in "(mine.py:12)", the same on any machine."""
    if type(error).__name__ == "BdbQuit":
        return "BdbQuit: breakpoint() has no terminal in a run: tsbench debug drives an episode with one"
    files = [(Path(f.f_code.co_filename), line) for f, line in traceback.walk_tb(error.__traceback__)]
    own = [(path, line) for path, line in files if path.is_absolute() and not _is_library(path)]
    return cause_of(error) + (f" ({own[-1][0].name}:{own[-1][1]})" if own else "")


def _is_library(path: Path) -> bool:
    return any(map(path.is_relative_to, _LIBRARIES)) or "site-packages" in path.parts


class TsbenchError(Exception):
    """Base of the errors that tsbench raises on purpose."""


class InputError(TsbenchError):
    """Bad input or wrong usage: the command line prints the message and exits with code 2."""


class SimulationError(TsbenchError):
    """SUMO refused a scene or broke off: the episode's outcome becomes `sim_error`."""


class PlannerOutputError(TsbenchError):
    """A planner returned something that is no command: the episode's outcome becomes `invalid_output`."""
