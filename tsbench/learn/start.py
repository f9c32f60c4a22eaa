"""How every training process begins: device, folder, threads, memory, and how it was called."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import torch

from tsbench.planners.batching import check_device

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


def prepare(out: Path, device: str, threads: int) -> None:
    """Make the folder of a training and set torch's threads. InputError where the device is missing."""
    check_device(device)
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(threads)


def command_line() -> str:
    """This process's, as a user would type it; `python -m tsbench` is told as `tsbench`."""
    name = Path(sys.argv[0]).name
    return " ".join(["tsbench" if name == "__main__.py" else name, *sys.argv[1:]])
