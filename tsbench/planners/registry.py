"""From what stands behind `--planner` to something that makes planners.

A planner is named by a registered name (entry-point group `tsbench.planners`), `pkg.module:Attribute` or
`file.py:Attribute`; the attribute is a class with `reset` and `act`, or a function `observation -> Control`. With
`nuplan:` before it, it makes a planner of nuPlan's protocol, and may have arguments: see `bridges.nuplan`. With `-e`
behind it, it is the expert that this planner makes: see `planners.experts.expert`.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from tsbench.core.errors import InputError
from tsbench.planners.base import Batched, Control, Infer, Planner, PlannerContext, Trajectory
from tsbench.planners.observation import Observation
from tsbench.planners.planner_spec import EXPERT, NUPLAN, PlannerSpec, import_attribute, parts_of

GROUP = "tsbench.planners"
EXPERT_MODULE = "tsbench.planners.experts.expert"
NUPLAN_MODULE = "tsbench.bridges.nuplan"
# What a planner's class may say of itself.
_FLAGS = ("privileged", "sign_access", "chooses_route", "floor", "keeps_process")


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

    target: `pkg.module:Attribute`. kind: a word for lists. privileged: is told the rule. sign_access: reads
    `Observation.signs`. chooses_route: by itself, so that no expert can lead it. parameters: how many learned ones.
    floor: reads no plate, and is there to show how far that leads. keeps_process: it has threads, processes or a device
    that a child of its process cannot use, so it keeps what it learns in an episode.
    """

    target: str
    kind: str = "user"
    privileged: bool = False
    sign_access: bool = True
    chooses_route: bool = False
    parameters: int | None = None
    weights: Weights | None = None
    floor: bool = False
    keeps_process: bool = False


@dataclass(frozen=True, slots=True)
class LoadedPlanner:
    """A planner that can drive.

    name: as it stands in records. factory: makes a fresh planner; a batched planner's takes `infer`. batched: the
    class of such a planner. spec: what the user wrote. sources: the modules or files that it is written in.
    """

    name: str
    factory: Callable[..., Planner]
    privileged: bool = False
    sign_access: bool = True
    chooses_route: bool = False
    spec: str = ""
    sources: tuple[str, ...] = ()
    batched: type[Batched] | None = None
    weights: Weights | None = None
    floor: bool = False
    keeps_process: bool = False

    @property
    def own(self) -> bool:
        """Is all of it part of this package, as `is_own` says of each source?"""
        return bool(self.sources) and all(map(is_own, self.sources))

    def on(self, device: str) -> LoadedPlanner:
        """The same planner with its network on a device; as it is where its network runs on the CPU only."""
        batched = self.batched
        if batched is None or device not in batched.served_on:
            return self
        return self.answered_by(lambda: batched.network(device))

    def answered_by(self, infer: Callable[[], Infer]) -> LoadedPlanner:
        """The same planner with answers from elsewhere in place of a network of its own; it must be `batched`."""
        return replace(self, factory=lambda: self.factory(infer=infer()))


class FunctionPlanner:
    """A function `observation -> Control` as a planner without state."""

    def __init__(self, function: Callable[[Observation], Control | Trajectory]) -> None:
        self._function = function

    def reset(self, context: PlannerContext) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Control | Trajectory:
        return self._function(observation)


@cache
def _registered() -> dict[str, EntryPoint]:
    points = {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda p: p.name)}
    # `NAME-e` is NAME's expert, whatever else is registered as that.
    return {name: p for name, p in points.items() if name.removesuffix(EXPERT) not in points.keys() - {name}}


@cache
def names() -> tuple[str, ...]:
    """Registered names and those of their experts, in alphabetical order."""
    return tuple(sorted([*_registered(), *_experts(_registered())]))


def _experts(bases: Iterable[str]) -> list[str]:
    known = {name: entry(name) for name in bases}
    return [f"{name}{EXPERT}" for name, one in known.items() if not (one.privileged or one.chooses_route)]


def entry(name: str) -> PlannerEntry:
    """What is known of a registered planner or its expert; not imported where the entry point names a PlannerEntry."""
    if name.endswith(EXPERT) and name not in _registered():
        base = entry(name.removesuffix(EXPERT))
        return replace(base, kind="expert", privileged=True, sign_access=True, floor=False)
    point = _registered()[name]
    target = import_attribute(point.module, point.attr, f"planner {name!r}")
    if isinstance(target, PlannerEntry):
        return target
    return _declared(target, f"{point.module}:{point.attr}")


def place_of(name: str) -> str:
    """The module that a registered planner is written in; of another package's, which is not imported, its entry's.

    Raises InputError for a name that is not registered.
    """
    if name not in _registered():
        raise InputError(_unknown(name))
    module = _registered()[name].module
    return entry(name).target.partition(":")[0] if module.split(".")[0] == "tsbench" else module


def source_of(spec: str) -> str:
    """The module or file that stands before the colon of a specification, or behind a registered name."""
    base = PlannerSpec(spec).base
    return parts_of(base)[1] if ":" in base else place_of(base)


def is_own(source: str) -> bool:
    """Is a module or file a planner of this package? Bridges bring planners of others."""
    return in_package(source) and not source.startswith("tsbench.bridges.")


def comes_with_tsbench(spec: str) -> bool:
    """Is a planner, or the planner that an expert is made of, written in this package? Nothing is imported."""
    base = PlannerSpec(spec).base
    known = _registered().get(base)
    return in_package(parts_of(base)[1] if known is None else known.module)


def in_package(source: str) -> bool:
    """Is a module, or a file, as it stands in a specification, one of this package's modules?"""
    return source.startswith("tsbench.") and not source.endswith(".py")


def resolve(spec: str) -> LoadedPlanner:
    """The planner that a specification names. Every failure is an InputError of one line."""
    parsed = PlannerSpec.parse(spec)
    if parsed.isolated_only:
        raise InputError(f"planner {spec!r}: a program is driven isolated only: add --isolate")
    base = parsed.base
    if base != spec and (":" in base or base in _registered()):
        return _expert(spec, resolve(base))
    if ":" in spec:
        _, source, attribute = parts_of(spec)
        return _loaded(spec, source, attribute, None)
    if spec not in _registered():
        raise InputError(_unknown(spec))
    known = entry(spec)
    module, _, attribute = known.target.partition(":")
    return _loaded(spec, module, attribute, known)


def _loaded(spec: str, source: str, attribute: str, known: PlannerEntry | None) -> LoadedPlanner:
    where = f"planner {spec!r}"
    if not source or not attribute:
        raise InputError(f"{where}: expected a registered name, pkg.module:Class or file.py:Class")
    nuplan = known is None and spec.startswith(NUPLAN)
    if nuplan:
        # Imported by name, as experts are.
        adapted = cast("Callable[..., type]", import_attribute(NUPLAN_MODULE, "adapted", where))
        target: object = adapted(source, attribute, where)
    else:
        target = import_attribute(source, attribute, where)
    factory = _factory(target, where)
    facts = known or _declared(target, f"{source}:{attribute}")
    return LoadedPlanner(
        name=spec if known else attribute.partition("(")[0],
        factory=factory,
        spec=spec,
        sources=(source, NUPLAN_MODULE) if nuplan else (source,),
        batched=cast("type[Batched]", target) if isinstance(target, type) and isinstance(target, Batched) else None,
        weights=facts.weights,
        **{name: getattr(facts, name) for name in _FLAGS},
    )


def _declared(target: object, place: str) -> PlannerEntry:
    """What a class says of itself, with what is taken for granted where it says nothing."""
    granted = PlannerEntry(place)
    told: dict[str, Any] = {name: bool(getattr(target, name, getattr(granted, name))) for name in _FLAGS}
    return replace(granted, **told)


def _expert(spec: str, base: LoadedPlanner) -> LoadedPlanner:
    """A planner within what the target sign's rule says. InputError where the planner cannot be led."""
    if base.privileged:
        raise InputError(f"planner {spec!r}: {base.spec} is told the rule already, so it has no expert")
    if base.chooses_route:
        raise InputError(
            f"planner {spec!r}: {base.spec} chooses its way by itself and follows no route, so it has no expert"
        )
    # Imported by name, so that the experts' code is part of these planners' hashes and not of every run's contract.
    wrap = cast("Callable[[Planner], Planner]", import_attribute(EXPERT_MODULE, "Expert", f"planner {spec!r}"))
    return replace(
        base,
        name=f"{base.name}{EXPERT}",
        factory=lambda **options: wrap(base.factory(**options)),
        privileged=True,
        sign_access=True,
        floor=False,
        spec=spec,
        sources=(*base.sources, EXPERT_MODULE),
    )


def _factory(target: object, where: str) -> Callable[..., Planner]:
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
    # Which experts there are is told by entries, and those of other packages are code that would run here.
    known = sorted([*_registered(), *_experts(name for name, p in _registered().items() if in_package(p.module))])
    close = difflib.get_close_matches(spec, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else f"registered are {', '.join(known)}"
    return f"planner {spec!r}: no such planner: {hint} (or pkg.module:Class, file.py:Class)"
