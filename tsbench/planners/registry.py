"""From what stands behind `--planner` to something that makes planners.

A planner is named by a registered name (entry-point group `tsbench.planners`), `pkg.module:Attribute` or
`file.py:Attribute`; the attribute is a class with `reset` and `act`, or a function `observation -> Control`.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from tsbench.core.errors import InputError
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Trajectory
from tsbench.planners.loading import import_attribute

GROUP = "tsbench.planners"


@dataclass(frozen=True, slots=True)
class Weights:
    """A file of learned parameters: size in bytes, SHA-256 (hex), where it is from."""

    file: str
    size: int
    sha256: str
    source: str


@dataclass(frozen=True, slots=True)
class PlannerEntry:
    """A registered planner as its entry point may name it, so that it is listed without being imported.

    target: `pkg.module:Attribute`. kind: a word for lists. sign_access: reads `Observation.signs`.
    parameters: how many learned ones.
    """

    target: str
    kind: str = "user"
    privileged: bool = False
    sign_access: bool = True
    parameters: int | None = None
    weights: Weights | None = None


@dataclass(frozen=True, slots=True)
class LoadedPlanner:
    """A planner that a run can use.

    name: as it stands in records. spec: what the user wrote. factory: makes a fresh planner.
    """

    name: str
    spec: str
    factory: Callable[[], Planner]
    privileged: bool = False
    sign_access: bool = True
    parameters: int | None = None
    weights: Weights | None = None


class FunctionPlanner:
    """A function `observation -> Control` as a planner without state."""

    def __init__(self, function: Callable[[Observation], Control | Trajectory]) -> None:
        self._function = function

    def reset(self, context: PlannerContext) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """What the function says."""
        return self._function(observation)


@cache
def _registered() -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda p: p.name)}


def names() -> tuple[str, ...]:
    """Registered names, in alphabetical order."""
    return tuple(_registered())


def entry(name: str) -> PlannerEntry:
    """What is known of a registered planner; not imported where its entry point names a PlannerEntry."""
    point = _registered()[name]
    target = import_attribute(point.module, point.attr, f"planner {name!r}")
    if isinstance(target, PlannerEntry):
        return target
    return PlannerEntry(
        target=f"{point.module}:{point.attr}",
        privileged=bool(getattr(target, "privileged", False)),
        sign_access=bool(getattr(target, "sign_access", True)),
    )


def resolve(spec: str) -> LoadedPlanner:
    """The planner that a specification names. Every failure is an InputError of one line."""
    if ":" in spec:
        source, _, attribute = spec.rpartition(":")
        return _loaded(spec, spec, source, attribute, None)
    if spec not in _registered():
        raise InputError(_unknown(spec))
    known = entry(spec)
    module, _, attribute = known.target.partition(":")
    return _loaded(spec, spec, module, attribute, known)


def _loaded(name: str, spec: str, source: str, attribute: str, known: PlannerEntry | None) -> LoadedPlanner:
    where = f"planner {spec!r}"
    if not source or not attribute:
        raise InputError(f"{where}: expected a registered name, pkg.module:Class or file.py:Class")
    target = import_attribute(source, attribute, where)
    factory = _factory(target, where)
    return LoadedPlanner(
        name=name if known else attribute,
        spec=spec,
        factory=factory,
        privileged=known.privileged if known else bool(getattr(target, "privileged", False)),
        sign_access=known.sign_access if known else bool(getattr(target, "sign_access", True)),
        parameters=known.parameters if known else None,
        weights=known.weights if known else None,
    )


def _factory(target: object, where: str) -> Callable[[], Planner]:
    """What makes planners from a class or a function; InputError where it has not the shape of a planner."""
    if inspect.isclass(target):
        missing = [name for name in ("reset", "act") if not callable(getattr(target, name, None))]
        if missing:
            raise InputError(f"{where}: the class has no method {' and no method '.join(missing)}")
        for method, argument in (("reset", "context"), ("act", "observation")):
            if not _takes(getattr(target, method), 2):
                raise InputError(f"{where}: {method} must take one argument ({argument})")
        if not _takes(target, 0):
            raise InputError(f"{where}: the class must be constructible without arguments")
        return cast("type[Planner]", target)
    if callable(target):
        if not _takes(target, 1):
            raise InputError(f"{where}: the function must take one argument (the observation)")
        return lambda: FunctionPlanner(target)
    raise InputError(
        f"{where}: a {type(target).__name__} is no planner: expected a class with reset and act, "
        "or a function observation -> Control"
    )


def _takes(target: Callable[..., object], count: int) -> bool:
    """Can it be called with `count` positional arguments? True where Python cannot tell (builtins)."""
    try:
        signature = inspect.signature(target)
    except ValueError:
        return True
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True


def _unknown(spec: str) -> str:
    if spec.endswith(".py"):
        return f"planner {spec!r}: name the class or function in it too, as in {spec}:MyPlanner"
    close = difflib.get_close_matches(spec, names(), n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else f"registered are {', '.join(names())}"
    return f"planner {spec!r}: no such planner: {hint} (or pkg.module:Class, file.py:Class)"
