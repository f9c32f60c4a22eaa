"""Errors that users meet. Each message is one line that names what, where and what to do.

Modules by name: those of packages that only an extra of pyproject.toml brings, and all modules of a package.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import traceback
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType

from tsbench.core.text import written_out

# Of Python and of tsbench.
_LIBRARIES = (Path(os.__file__).parent, Path(__file__).resolve().parents[1])


EXTRA_OF = {
    "confusable_homoglyphs": "report",
    "jinja2": "report",
    "markupsafe": "report",
    "matplotlib": "report",
    "pandas": "report",
    "PIL": "report",
    "resvg_py": "report",
    "statsmodels": "report",
    "imageio_ffmpeg": "video",
    "osmium": "make",
    "sumo": "make",
    "gymnasium": "learn",
    "stable_baselines3": "learn",
    "tensorboard": "learn",
    "torch": "learn",
    "ray": "ray",
    "foxglove": "mcap",
}
CPU_INDEX = "--extra-index-url https://download.pytorch.org/whl/cpu"
# On no index: repositories of GitHub.
CHECKOUTS = {"nuplan": "motional/nuplan-devkit", "tuplan_garage": "autonomousvision/tuplan_garage"}
# Packages that are not called as what is imported from them.
_PACKAGES = {"commonroad": "commonroad-io", "cv2": "opencv-python-headless", "yaml": "pyyaml"}


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
    library = {path for path, _ in files if any(map(path.is_relative_to, _LIBRARIES)) or "site-packages" in path.parts}
    own = [(path, line) for path, line in files if path.is_absolute() and path not in library]
    return cause_of(error) + (f" ({own[-1][0].name}:{own[-1][1]})" if own else "")


class TsbenchError(Exception):
    """Base of the errors that tsbench raises on purpose."""


class InputError(TsbenchError):
    """Bad input or wrong usage: the command line prints the message and exits with code 2."""


class SimulationError(TsbenchError):
    """SUMO refused a scene or broke off: the episode's outcome becomes `sim_error`."""


class PlannerOutputError(TsbenchError):
    """A planner returned something that is no command: the episode's outcome becomes `invalid_output`."""


def install_command(module: str) -> str:
    """What installs a missing module: the extra of tsbench that has it, a checkout, or the package of its name."""
    top = module.partition(".")[0]
    if top in CHECKOUTS:
        folder = CHECKOUTS[top].partition("/")[2]
        then = f"pip install --no-deps ./{folder}" if top == "nuplan" else f"add {folder} to PYTHONPATH"
        return f"git clone https://github.com/{CHECKOUTS[top]}, and {then} (docs/adapters.md)"
    package = _PACKAGES.get(top, top.replace("_", "-"))
    if top not in EXTRA_OF:
        return f"pip install {package}"
    # Plain, pip takes a build of torch for a GPU, which is ten times as large.
    without_gpu = f" (without a GPU: add {CPU_INDEX})" if EXTRA_OF[top] == "learn" else ""
    return f"pip install 'tsbench[{EXTRA_OF[top]}]'{without_gpu}"


def missing_extra(problem: ModuleNotFoundError) -> InputError | None:
    """What to tell the user where the module that is missing is one of an extra; None for any other module."""
    name = (problem.name or "").partition(".")[0]
    if name not in EXTRA_OF:
        return None
    return InputError(f"this needs {name}, which is not installed: {install_command(name)}")


def load(module: str) -> ModuleType:
    """Import a module. Raises InputError naming the extra where a package of one is missing."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as problem:
        raise missing_extra(problem) or problem from None


def import_all(package: str) -> Mapping[str, ModuleType]:
    """The modules of a package, by their names in it, sorted.

    Where the package is written out in the call, all of them belong to what its file depends on (`core.provenance`).
    """
    folder = import_module(package).__path__
    return {one.name: import_module(f"{package}.{one.name}") for one in pkgutil.iter_modules(folder)}
