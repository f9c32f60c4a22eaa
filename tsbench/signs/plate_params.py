"""What stands on a plate of each kind of rule beside its code and its place: the parts of the map that it rules.

A plate's params are written as texts (`PlateParams.texts`) and read back once, when its scene is read (`read_params`).
Each field's metadata says what its names are names of; that these are there is checked against the map by
`tsbench.sim.scene.Scene`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TypeVar

NAMES = "names"
EDGE, LANE = {NAMES: "edge"}, {NAMES: "lane"}
JUNCTION, CROSSING, OBSTACLE = {NAMES: "junction"}, {NAMES: "crossing"}, {NAMES: "obstacle"}


@dataclass(frozen=True)
class PlateParams:
    """Base of all: fields are one name (str) or several in order (tuple of str)."""

    def named(self) -> dict[str, tuple[str, ...]]:
        """The names of each field."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {key: (value,) if isinstance(value, str) else value for key, value in values.items()}

    def texts(self) -> dict[str, str]:
        """As they stand in a scene file: several names with spaces between."""
        return {key: " ".join(names) for key, names in self.named().items()}


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
    """main_in: the edges into the junction whose vehicles have priority."""

    main_in: tuple[str, ...] = field(metadata=EDGE)


@dataclass(frozen=True)
class RoundaboutParams(GiveWayParams):
    """ring: all its edges in driving order. `main_in` is the one that leads to the entry."""

    ring: tuple[str, ...] = field(metadata=EDGE)


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
    wanted = {f.name: f.type for f in fields(kind)}
    for key in wanted:
        if not given.get(key, "").split():
            raise ValueError(f"param {key!r} is missing")
    strange = sorted(set(given) - set(wanted))
    if strange:
        raise ValueError(f"param {strange[0]!r} is none of {', '.join(wanted)}")
    names = {key: tuple(text.split()) for key, text in given.items()}
    for key, several in names.items():
        if wanted[key] == "str" and len(several) != 1:
            raise ValueError(f"param {key!r} must be one name, not {given[key]!r}")
    return kind(**{key: several[0] if wanted[key] == "str" else several for key, several in names.items()})
