"""What stands on a plate of each kind of rule beside its code and its place: the parts of the map that it rules.

A plate's params are written as texts (`PlateParams.texts`) and read back once, when its scene is read (`read_params`).
Each field's metadata says what its names are names of, a number has none; that these are there is checked against the
map by `tsbench.sim.scene.Scene`. What a contrast scene asks beside its plate is written alike (`signs.contrast`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, TypeVar

NAMES = "names"
EDGE, LANE = {NAMES: "edge"}, {NAMES: "lane"}
JUNCTION, CROSSING, OBSTACLE = {NAMES: "junction"}, {NAMES: "crossing"}, {NAMES: "obstacle"}


@dataclass(frozen=True)
class PlateParams:
    """Base of all: fields are one name (str), several in order (tuple of str) or a number (float)."""

    def named(self) -> dict[str, tuple[str, ...]]:
        """The names of each field that holds names."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if NAMES in f.metadata}
        return {key: (value,) if isinstance(value, str) else value for key, value in values.items()}

    def texts(self) -> dict[str, str]:
        """As they stand in a scene file: several names with spaces between, none left out."""
        numbers = {f.name: repr(float(getattr(self, f.name))) for f in fields(self) if NAMES not in f.metadata}
        return {**{key: " ".join(names) for key, names in self.named().items() if names}, **numbers}


@dataclass(frozen=True)
class ApproachParams(PlateParams):
    """approach: the edge on which the ego comes to the junction before the plate, or at it."""

    approach: str = field(metadata=EDGE)


@dataclass(frozen=True)
class JunctionParams(ApproachParams):
    """junction: the one at the end of the approach."""

    junction: str = field(metadata=JUNCTION)


@dataclass(frozen=True)
class GiveWayParams(JunctionParams):
    """main_in: the edges into the junction whose vehicles have priority, if any."""

    main_in: tuple[str, ...] = field(default=(), metadata=EDGE)


@dataclass(frozen=True)
class RoundaboutParams(GiveWayParams):
    """ring: all its edges in driving order. `main_in` is the one that leads to the entry."""

    ring: tuple[str, ...] = field(metadata=EDGE, kw_only=True)


@dataclass(frozen=True)
class ZoneParams(PlateParams):
    """zone_edges: in order, the plate's own first; none behind a junction where the sign ends there."""

    zone_edges: tuple[str, ...] = field(metadata=EDGE)


@dataclass(frozen=True)
class ReservedLaneParams(ZoneParams):
    """approach: the edge before the plate. lanes: the reserved ones, of these edges or of the opposite direction."""

    approach: str = field(metadata=EDGE)
    lanes: tuple[str, ...] = field(metadata=LANE)


@dataclass(frozen=True)
class CrosswalkParams(PlateParams):
    """crossing: its id in the network. exit: the edge behind it on the ego's way."""

    crossing: str = field(metadata=CROSSING)
    exit: str = field(metadata=EDGE)


@dataclass(frozen=True)
class ObstacleParams(PlateParams):
    """obstacle: its id in the scene."""

    obstacle: str = field(metadata=OBSTACLE)


Params = TypeVar("Params", bound=PlateParams)


def read_params(kind: type[Params], given: Mapping[str, str]) -> Params:
    """The params of one kind from their texts. Raises ValueError for one that is missing, empty or of no such kind."""
    wanted = {f.name: f for f in fields(kind)}
    for key, param in wanted.items():
        if not given.get(key, "").split() and (key in given or param.default is MISSING):
            raise ValueError(f"param {key!r} is missing")
    strange = sorted(set(given) - set(wanted))
    if strange:
        raise ValueError(f"param {strange[0]!r} is none of {', '.join(wanted)}")
    return kind(**{key: _value(wanted[key], text) for key, text in given.items()})


def _value(param: Field[Any], text: str) -> str | tuple[str, ...] | float:
    names = tuple(text.split())
    if NAMES in param.metadata and param.type != "str":
        return names
    if len(names) != 1:
        raise ValueError(f"param {param.name!r} must be one name, not {text!r}")
    if NAMES in param.metadata:
        return names[0]
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"param {param.name!r}: {text} is not a finite number")
    return number
