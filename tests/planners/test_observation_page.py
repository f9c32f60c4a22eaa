"""`docs/reference/observation.md` and `docs/api.md` against the classes that planners are given and give back."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from simworld import simulation

from tsbench.episode.episode import Episode
from tsbench.planners.base import Control, PlannerContext, Privilege, Trajectory
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation
from tsbench.scenarios.data_set import DataSet
from tsbench.sim.world import ActorKind, Indicator, WorldSnapshot

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "reference/observation.md"
# What they are made of is for experts, and internal.
EXPERTS = (WorldSnapshot, Privilege)


def name_of(kind: Any) -> str:
    """A type as the page says it."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is np.ndarray:
        return f"{np.dtype(typing.get_args(inner[1])[0])} array"
    if origin in (typing.Union, types.UnionType):
        return " or ".join(name_of(one) for one in inner)
    if origin is tuple:
        return f"tuple of {name_of(inner[0])}"
    if origin is not None and issubclass(origin, Mapping):
        return f"mapping of {name_of(inner[0])} to {name_of(inner[1])}"
    return "None" if kind is type(None) else str(kind.__name__)


def fields(kind: type) -> dict[str, str]:
    """The public fields and properties of a class with their types."""
    found = {name: hint for name, hint in typing.get_type_hints(kind).items() if not name.startswith("_")}
    for name, value in vars(kind).items():
        if isinstance(value, property) and value.fget is not None:
            found[name] = typing.get_type_hints(value.fget)["return"]
    return {name: name_of(hint) for name, hint in found.items()}


def classes_in(kind: Any) -> Iterator[type]:
    """The classes of tsbench that a type is made of."""
    if isinstance(kind, type) and kind.__module__.startswith("tsbench."):
        yield kind
    for inner in typing.get_args(kind):
        yield from classes_in(inner)


def shown() -> dict[str, type]:
    """By name: every class that a planner is given or gives back, down to plain values."""
    found: dict[str, type] = {}
    waiting: list[type] = [Observation, PlannerContext, Control, Trajectory]
    while waiting:
        kind = waiting.pop()
        if kind.__name__ in found:
            continue
        found[kind.__name__] = kind
        hints = typing.get_type_hints(kind)
        public = [hint for name, hint in hints.items() if not name.startswith("_")]
        waiting += [] if kind in EXPERTS else [one for hint in public for one in classes_in(hint)]
    return found


def documented() -> dict[str, dict[str, str]]:
    """By class: the fields of its table with their types."""
    parts = re.split(r"^### `(\w+)`$", PAGE.read_text(encoding="utf-8"), flags=re.M)
    row = re.compile(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", re.M)
    return {name: dict(row.findall(part)) for name, part in zip(parts[1::2], parts[2::2], strict=True)}


def test_every_field_is_on_the_page_and_nothing_else() -> None:
    assert documented() == {name: fields(kind) for name, kind in shown().items()}


def test_the_reference_lists_every_class() -> None:
    listed: set[str] = set()
    blocks = re.findall(
        r"^::: (\S+)\n(?:    options:\n      members: \[([^\]]*)\])?",
        (DOCS / "api.md").read_text(encoding="utf-8"),
        re.M,
    )
    for target, members in blocks:
        names = [f"{target}.{name.strip()}" for name in members.split(",")] if members else [target]
        listed |= set(names)
    missing = [name for name, kind in shown().items() if f"{kind.__module__}.{kind.__qualname__}" not in listed]
    assert missing == []
    assert {f"tsbench.sim.world.{kind.__name__}" for kind in (ActorKind, Indicator)} <= listed


class Keeping:
    """Drives as `idm` does, and keeps what it saw."""

    def __init__(self) -> None:
        self.seen: list[Observation] = []
        self.driver = Idm()

    def reset(self, context: PlannerContext) -> None:
        self.driver.reset(context)

    def act(self, o: Observation) -> Control:
        self.seen.append(o)
        return self.driver.act(o)


def test_what_the_page_says_of_a_drive() -> None:
    planner = Keeping()
    row = next(row for row in DataSet().table("dev") if row.scenario_type == "yield" and row.variant == 1)
    episode = Episode(row, simulation=simulation())
    context = episode.context
    planner.reset(context)
    while episode.result is None and len(planner.seen) < 60:
        episode.step(planner.act(episode.observation))
    assert [len(seen.history) for seen in planner.seen[:25]] == [*range(1, 21), *[20] * 5]
    first = planner.seen[0]
    assert (first.step, first.time, first.truth, context.dt) == (0, 0.0, None, 0.1)
    away = np.hypot(*(first.actors.pose[:, :2] - (first.ego.x, first.ego.y)).T)
    assert len(away) > 1
    assert away.tolist() == sorted(away.tolist())
    for seen in planner.seen:
        assert seen.history[-1].tolist() == [seen.ego.x, seen.ego.y, seen.ego.heading, seen.ego.speed]
        assert seen.actors.ids.tolist() == sorted(seen.actors.ids.tolist())
        assert [sign.distance for sign in seen.signs] == sorted(sign.distance for sign in seen.signs)
        assert seen.route.path is first.route.path
