"""`tsbench run` from Python."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from tsbench.api.loaded_run import Run
from tsbench.core.errors import InputError
from tsbench.core.paths import expanded_text
from tsbench.core.streams import progress_console
from tsbench.run.listener import ProgressWatcher, listeners_of
from tsbench.run.options import TOML, RunOptions, from_python, keywords, options_in, toml_section
from tsbench.run.session import run
from tsbench.scenarios.data_set import DataSet

# A name, pkg.module:Class, file.py:Class; a class; or a function observation -> Control.
Given = str | type[Any] | Callable[..., Any]
_WORKER = "tsbench.run.execution.worker_main"


def evaluate(planner: Given | Sequence[Given] = (), **options: Any) -> Run:
    """Run planners on scenarios; the same call again continues an interrupted run, or reads a complete one.

    planner: one or several; a name, "pkg.module:Class", "file.py:Class", or a class or function that is written in a
    file. options: those of `tsbench run`, such as split="dev", types=["stop"], mask_signs=True; `help(evaluate)` names
    all. listeners: objects, or what `--listener` takes. What is not given is taken from the section [run] of the
    folder's `tsbench.toml`, if there is one; a planner and a split must come from one of the two. Raises InputError:
    wrong options, bad input, or a folder that cannot be used.
    """
    if getattr(sys.modules["__main__"].__spec__, "name", "") == _WORKER:
        raise InputError('evaluate is called while a worker imports a planner: put it below if __name__ == "__main__":')
    _SIGNATURE.bind(planner, **options)
    with keywords():
        given = {"planners": planner, **options} if planner != () else options
        values = {**_from_file(given), **from_python(RunOptions, given)}
        if values.get("split") is None:
            raise InputError("split: name one (split=…), here or in the section [run] of tsbench.toml")
        planners = values.get("planners", ())
        planners = planners if isinstance(planners, list | tuple) else [planners]
        values["planners"] = tuple(map(spec_of, planners))
        told = listeners_of(values.get("listeners", ()))
        values["city"] = DataSet.driven(values.get("city")).name
        return Run(run(RunOptions(**values), ProgressWatcher(progress_console()), told).folder)


def _signature() -> inspect.Signature:
    """Of `evaluate`: every option of a run is a keyword."""
    kind = inspect.Parameter.KEYWORD_ONLY
    default = {f.name: f.default for f in fields(RunOptions) if f.default is not MISSING}
    default |= {"city": None, "types": None}
    keys = [inspect.Parameter(name, kind, default=default.get(name)) for name in options_in(RunOptions)]
    first = inspect.Parameter("planner", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=())
    return inspect.Signature([first, *(key for key in keys if key.name != "planners")])


_SIGNATURE = _signature()
evaluate.__signature__ = _SIGNATURE  # type: ignore[attr-defined]


def _from_file(given: Mapping[str, Any]) -> dict[str, Any]:
    """What is missing and stands in this folder's tsbench.toml; it is said what that is."""
    section = toml_section(TOML, "run")
    if not isinstance(section, dict):
        raise InputError(f"{TOML}: run: expected a section, [run]")
    names = {"planner": "planners", "listener": "listeners"}
    found = {names.get(key, key.replace("-", "_")): (key, value) for key, value in section.items()}
    if unknown := [key for name, (key, _) in found.items() if name not in options_in(RunOptions)]:
        raise InputError(f"{TOML}: [run] {unknown[0]}: no such option; there are {', '.join(options_in(RunOptions))}")
    missing = {name: value for name, (_, value) in found.items() if name not in given}
    if missing:
        print(f"{TOML}: {', '.join(found[name][0] for name in missing)}", file=sys.stderr)
    try:
        return from_python(RunOptions, missing)
    except InputError as problem:
        raise InputError(f"{TOML}: [run] {problem}") from None


def spec_of(planner: Given) -> str:
    """What `--planner` would be given. Raises InputError for what the processes of a run cannot import."""
    if isinstance(planner, str):
        return expanded_text(planner)
    if not (inspect.isclass(planner) or inspect.isfunction(planner)):
        raise InputError(f"planner: expected a name, a class or a function, not {type(planner).__name__}")
    name, module = planner.__qualname__, sys.modules[planner.__module__]
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part, None)
    source = _source(planner.__module__)
    if found is not planner or source is None:
        raise InputError(
            f"planner {name}: the processes of a run cannot import it, as it is not at the top of a file: write it to "
            f"one (in a notebook: %%writefile planner.py) and give 'planner.py:{name}'"
        )
    return f"{source}:{name}"


def _source(module: str) -> str | None:
    """A module as a worker imports it; None for what was typed in."""
    if module != "__main__":
        return module
    main = sys.modules[module]
    if main.__spec__ is not None:
        return main.__spec__.name
    file = getattr(main, "__file__", None)
    return file if file is not None and file.endswith(".py") else None
