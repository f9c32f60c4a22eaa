"""This machine: Python, cores, memory, disk, GPU, and programs that only some commands need."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tsbench.core.extras import install_command
from tsbench.tools.doctor.finding import REPAIR, TIMEOUT_S, Diagnosis, Status, alone, installed

LEAST_PYTHON = (3, 11)
# A worker that drives `idm` was measured at 0.18 GiB, a trace at 0.12 MB: with some room, and for 5,800 scenes.
WORKER_GIB, RUN_GIB = 0.5, 1.0
_GIB = 2.0**30


def check_python() -> Iterator[Diagnosis]:
    """Version and system: death of workers is watched by means that only Linux has."""
    text = f"{platform.python_implementation()} {platform.python_version()} on {platform.platform()}"
    least = ".".join(str(n) for n in LEAST_PYTHON)
    if sys.version_info < LEAST_PYTHON:
        yield Diagnosis(Status.FAILED, "Python", text, f"install Python {least} or later")
    elif sys.platform != "linux":
        yield Diagnosis(Status.FAILED, "Python", text, "tsbench run needs Linux")
    else:
        yield Diagnosis(Status.OK, "Python", text)


def check_machine() -> Iterator[Diagnosis]:
    """Cores that this process may use, free memory for a worker on each, free disk here."""
    cores = len(os.sched_getaffinity(0))
    yield Diagnosis(
        Status.OK, "machine", f"{cores} cores: tsbench run starts {cores} workers unless told --workers"
    )
    memory = _free_memory() / _GIB
    text = f"{memory:.1f} GiB of memory free"
    if memory < WORKER_GIB * cores:
        remedy = f"{cores} workers should have {WORKER_GIB * cores:.1f} GiB: run fewer with --workers"
        yield Diagnosis(Status.NOTE, "machine", text, remedy)
    else:
        yield Diagnosis(Status.OK, "machine", text)
    here = Path.cwd()
    disk = shutil.disk_usage(here).free / _GIB
    text = f"{disk:.1f} GiB of disk free at {here}"
    if disk < RUN_GIB:
        remedy = f"traces of a planner on the whole test split can take {RUN_GIB:.0f} GiB: write elsewhere with --out"
        yield Diagnosis(Status.NOTE, "machine", text, remedy)
    else:
        yield Diagnosis(Status.OK, "machine", text)


def check_tools() -> Iterator[Diagnosis]:
    try:
        import imageio_ffmpeg

        program = imageio_ffmpeg.get_ffmpeg_exe()
        done = subprocess.run(
            [program, "-version"], capture_output=True, text=True, timeout=TIMEOUT_S, check=True
        )
        yield Diagnosis(Status.OK, "ffmpeg", " ".join(done.stdout.split()[:3]))
    except (ImportError, RuntimeError, OSError, subprocess.SubprocessError) as problem:
        remedy = "needed for --format mp4 only: pip install 'tsbench[video]'"
        yield Diagnosis(Status.NOTE, "ffmpeg", f"none that runs: {problem}", remedy)
    browser = next(
        (p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name))), None
    )
    if browser is None:
        remedy = "needed for the tests of pages only; reports open in any browser"
        yield Diagnosis(Status.NOTE, "browser", "no Chromium", remedy)
    else:
        yield Diagnosis(Status.OK, "browser", browser)


def check_gpu() -> Iterator[Diagnosis]:
    if not installed(("torch",)):
        remedy = f"needed for training and --device cuda only: {install_command('torch')}"
        yield Diagnosis(Status.NOTE, "torch", "not installed", remedy)
        return
    see = "torch.cuda.get_device_name(0) if torch.cuda.is_available() else ''"
    code, words = alone(f"import torch; print(torch.__version__ + '|' + ({see}))")
    number, _, gpu = words.partition("|")
    if code:
        yield Diagnosis(Status.FAILED, "torch", f"cannot be imported: {words}", REPAIR)
    elif gpu:
        yield Diagnosis(Status.OK, "torch", f"{number}, GPU: {gpu}")
    else:
        yield Diagnosis(
            Status.NOTE,
            "torch",
            f"{number}, no GPU",
            "learned planners run on the CPU; training takes longer",
        )


def _free_memory() -> int:
    """Bytes that a new process can have, caches included."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")) * 1024
