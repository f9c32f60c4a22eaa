"""Programs of the system that make sandboxes and containers, asked in one call."""

from __future__ import annotations

import subprocess
from typing import Final

from tsbench.core.text import one_line

_ANSWER_S: Final = 60.0
_LONGEST: Final = 200


def asked(*command: str) -> tuple[int, str, str]:
    """Exit status, output, and the last line of what went wrong."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=_ANSWER_S, check=False
        )
    except subprocess.TimeoutExpired:
        return 1, "", f"no answer within {_ANSWER_S:.0f} s"
    except OSError as problem:
        return 1, "", str(problem.strerror)
    lines = [one_line(line) for line in done.stderr.splitlines() if line.strip()]
    return done.returncode, done.stdout, (lines[-1] if lines else f"exit code {done.returncode}")[:_LONGEST]
