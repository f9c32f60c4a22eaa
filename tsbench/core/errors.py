"""Errors that users meet. Each message is one line that names what, where and what to do."""

from __future__ import annotations

from tsbench.core.text import written_out


def cause_of(error: BaseException) -> str:
    """Kind and text of a foreign exception, on one line, fit for any file: its text may be no text at all."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = "(its text cannot be had)"
    return written_out(f"{type(error).__name__}: {text}")


class TsbenchError(Exception):
    """Base of the errors that tsbench raises on purpose."""


class InputError(TsbenchError):
    """Bad input or wrong usage: the command line prints the message and exits with code 2."""


class SimulationError(TsbenchError):
    """SUMO refused a scene or broke off: the episode's outcome becomes `sim_error`."""


class PlannerOutputError(TsbenchError):
    """A planner returned something that is no command: the episode's outcome becomes `invalid_output`."""
