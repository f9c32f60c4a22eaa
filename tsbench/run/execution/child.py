"""What the processes that a run starts have in common."""

from __future__ import annotations

import signal

# One simulation is one thread; maths libraries that start one thread per core only get in each other's way, and how
# many there are decides how their sums are rounded.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "ARROW_IO_THREADS"),
    "1",
)


def cause_of_end(status: int) -> str:
    """An exit status in words."""
    if status >= 0:
        return f"exit code {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"signal {-status}"
