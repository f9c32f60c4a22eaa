"""How long a test waits for what should happen at once: it ends what hangs, and measures nothing."""

from __future__ import annotations

import time
from collections.abc import Callable

HANG_S = 600.0
_STEP_S = 0.02


def eventually(holds: Callable[[], bool]) -> None:
    """Wait until something holds. Raises AssertionError where it does not come to that."""
    end = time.monotonic() + HANG_S
    while not holds():
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(_STEP_S)
