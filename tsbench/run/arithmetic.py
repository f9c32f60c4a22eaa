"""What decides the last bits of a machine's arithmetic: written into `run.json`, and compared before a run goes on.

Names of processors and libraries say little: what counts is what comes out. So the functions that choose their code by
the CPU are asked, and their answers hashed.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import platform
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tsbench.core.provenance import versions
from tsbench.planners.registry import comes_with_tsbench

Facts = dict[str, Any]

_TORCH = "torch"
_PACKAGES = ("numpy", "scipy", "shapely", "opencv-python-headless", _TORCH)
# Variants of a function differ in one of a thousand results or so.
_POINTS = 20_000
_KERNEL_NAMES = ("scipy_openblas_get_corename64_", "openblas_get_corename64_", "openblas_get_corename")


@cache
def facts() -> Facts:
    """simd, blas, libc: what is in use, in words. versions: of packages, None where not installed.

    answers: hashes of what `libm` (by Python's `math`), `numpy`'s functions and `blas` (products that round) answer.
    """
    config = np.show_config(mode="dicts")
    assert isinstance(config, dict)
    simd, blas = config["SIMD Extensions"], config["Build Dependencies"]["blas"]
    return {
        "simd": [*simd["baseline"], *simd.get("found", ())],
        "blas": " ".join(filter(None, (blas["name"], blas.get("version"), _kernel()))),
        "libc": " ".join(platform.libc_ver()),
        "versions": versions(_PACKAGES),
        "answers": {"libm": _libm(), "numpy": _numpy(), "blas": _blas()},
    }


def differences(
    old: Facts | None, new: Facts, planners: Sequence[str], device: str, torch: bool = True
) -> tuple[str, ...]:
    """In what two arithmetics differ that can change an episode, each as "WHAT is A, not B".

    planners: their specs. tsbench's own depend on the CPU by libm alone; of others, and of a GPU, nothing is known.
    torch: may others have imported it?
    """
    if old is None:
        return ("the arithmetic is not recorded",)
    known = device == "cpu" and all(map(comes_with_tsbench, planners))
    found = []
    for name, was in old["versions"].items():
        now = new["versions"].get(name)
        if was != now and (name != _TORCH or (torch and not known) or device != "cpu"):
            found.append(f"{name} is {was}, not {now}")
    for name, was in old["answers"].items():
        if was != new["answers"][name] and (name == "libm" or not known):
            said = {"libm": "libc", "numpy": "simd", "blas": "blas"}[name]
            found.append(f"the arithmetic of {name} is another ({_words(old[said])}, now {_words(new[said])})")
    return tuple(found)


def _words(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _kernel() -> str:
    """Which of its kernels OpenBLAS has chosen; "" for another library."""
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.is_file() else []
    paths = sorted({line.split(maxsplit=5)[-1] for line in lines if "openblas" in line})
    # SciPy brings one of its own, which nothing here multiplies with.
    for path in [path for path in paths if "numpy" in path] or paths:
        library = ctypes.CDLL(path)
        for name in _KERNEL_NAMES:
            if hasattr(library, name):
                ask: Callable[[], bytes] = getattr(library, name)
                ask.restype = ctypes.c_char_p  # type: ignore[attr-defined]
                return ask().decode()
    return ""


def _points() -> tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]]]:
    rng = np.random.default_rng(np.random.SeedSequence(19))
    return rng.uniform(-7.0, 7.0, _POINTS), rng.uniform(0.0, 7.0, _POINTS)


def _libm() -> str:
    x, y = (points.tolist() for points in _points())
    results = [[f(v) for v in x] for f in (math.sin, math.cos, math.tan, math.exp)]
    results += [[math.log(v) for v in y], [math.atan2(a, b) for a, b in zip(x, y, strict=True)]]
    return _hash(np.array(results))


def _numpy() -> str:
    x, y = _points()
    functions = (np.sin, np.cos, np.tan, np.exp, np.tanh)
    return _hash(np.array([*(f(x) for f in functions), np.log(y), np.arctan2(x, y), np.hypot(x, y), np.power(y, x)]))


def _blas() -> str:
    x, y = _points()
    left, right = x[:15_000].reshape(100, 150), y[:15_000].reshape(150, 100)
    single = left.astype(np.float32) @ right.astype(np.float32)
    return _hash(np.concatenate([(left @ right).ravel(), (left @ right[:, 0]).ravel(), single.ravel()]))


def _hash(values: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()[:16]
