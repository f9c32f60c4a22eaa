"""How a training process keeps its memory."""

from __future__ import annotations

import ctypes

# Of malloc.h (glibc).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_NEVER = 2**31 - 1
_LARGEST = 2**30


def keep_freed_memory() -> None:
    """Have glibc reuse large blocks instead of giving them back.

    A batch of rasters is 150 MB, and the kernel clearing fresh pages for it costs more than the convolutions do.
    Other C libraries are left as they are.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        libc.mallopt(_M_TRIM_THRESHOLD, _NEVER)
