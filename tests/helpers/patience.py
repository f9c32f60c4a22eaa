"""How long a test waits for what should happen at once: it ends what hangs, and measures nothing."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from typing import Any

HANG_S = 600.0
_STEP_S = 0.02


def eventually(
    holds: Callable[[], bool], process: subprocess.Popen[Any] | None = None, patience_s: float = HANG_S
) -> None:
    """Wait until something holds. Raises AssertionError where it does not come to that, or `process` ends before."""
    end = time.monotonic() + patience_s
    while not holds():
        assert process is None or process.poll() is None, f"{process.args} ended before it came to that"
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(_STEP_S)
