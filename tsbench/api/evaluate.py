"""`tsbench run` from Python."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from tsbench.api.loaded_run import Run
from tsbench.core.errors import InputError
from tsbench.core.paths import expanded_text
from tsbench.core.streams import progress_console
from tsbench.episode.perception_level import EXACT
from tsbench.run.arguments import keywords, number_of, path_of, switch, text, type_words, whole_number
from tsbench.run.execution.executor import Limits
from tsbench.run.listener import Listener, listeners_of
from tsbench.run.plan import BOTH, Request
from tsbench.run.run_options import LEAST_MEMORY_MB, Options
from tsbench.run.run_progress import ProgressWatcher
from tsbench.run.session import run
from tsbench.scenarios.data_set import DataSet

# A name, pkg.module:Class, file.py:Class; a class; or a function observation -> Control.
Given = str | type[Any] | Callable[..., Any]
_WORKER = "tsbench.run.execution.worker_main"
_P = ParamSpec("_P")
_R = TypeVar("_R")


def _with_file(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Fill arguments that are not given from the section [run] of this folder's tsbench.toml, as the command does."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def filled(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        given = signature.bind(*args, **kwargs)
        _fill(given.arguments)
        return function(*given.args, **given.kwargs)

    return filled


def _fill(given: dict[str, Any]) -> None:
    """Add what is missing and stands in the file, and say what that is."""
    if not Path("tsbench.toml").is_file():
        return
    # The options of the command itself: there is no second list of them.
    from tsbench.cli.config import tell, values_of
    from tsbench.cli.run import run as command

    renamed = {"planners": "planner"}
    values = {renamed.get(name, name): value for name, value in values_of(command, "run").items()}
    missing = {name: value for name, value in values.items() if name not in given}
    given.update(missing)
    tell(missing)


@_with_file
@keywords()
def evaluate(
    planner: Given | Sequence[Given] = (),
    *,
    split: str | None = None,
    city: str | None = None,
    types: str | Sequence[str] | None = None,
    limit: int | None = None,
    variants: str = "all",
    half: str = BOTH,
    workers: int | None = None,
    memory_limit: float = Limits.most_memory,
    executor: str = "local",
    out: str | Path | None = None,
    trace: str = "violations",
    device: str = "cpu",
    mask_signs: bool = False,
    perception: str | Path = EXACT,
    isolate: bool = False,
    image: str | None = None,
    overwrite: bool = False,
    allow_partial: bool = False,
    listeners: Sequence[str | Listener] = (),
) -> Run:
    """Run planners on scenarios; the same call again continues an interrupted run, or reads a complete one.

    planner: one or several; a name, "pkg.module:Class", "file.py:Class", or a class or function that is written in a
    file. types: None = all. listeners: objects, or what `--listener` takes. All else is as in `tsbench run`. What is
    not given is taken from the section [run] of the folder's `tsbench.toml`, if there is one; a planner and a split
    must come from one of the two. Raises InputError: wrong options, bad input, or a folder that cannot be used.
    """
    if getattr(sys.modules["__main__"].__spec__, "name", "") == _WORKER:
        raise InputError(
            'evaluate is called while a worker imports a planner: put it below if __name__ == "__main__":'
        )
    if split is None:
        raise InputError("split: name one (split=…), here or in the section [run] of tsbench.toml")
    given = planner if isinstance(planner, list | tuple) else [planner]
    told = listeners_of(listeners)
    names, words = tuple(map(spec_of, given)), type_words("types", types)
    most = None if limit is None else whole_number("limit", limit)
    request = Request(names, split, words, most, variants, half)
    options = Options(
        request=request, workers=None if workers is None else whole_number("workers", workers), executor=executor,
        out=None if out is None else path_of("out", out), trace=trace, device=device,
        mask_signs=switch("mask_signs", mask_signs), perception=expanded_text(str(perception)),
        isolate=switch("isolate", isolate), image=None if image is None else text("image", image),
        overwrite=switch("overwrite", overwrite), allow_partial=switch("allow_partial", allow_partial),
        limits=Limits(most_memory=number_of("memory_limit", memory_limit, LEAST_MEMORY_MB)),
    )  # fmt: skip
    data = DataSet.driven(None if city is None else text("city", city))
    return Run(run(replace(options, city=data.name), ProgressWatcher(progress_console()), told).folder)


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
