"""What a contrast scene asks of the ego beside the rule of its plate: no obedience to what the plate does not ask.

Each clause is a `<poi type="contrast">` of the scene's additional file, with its params as a plate's (`plate_params`).
Monitors read them; no planner sees them. Source: docs/contrast.md, "Needless obedience".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from lxml import etree

from tsbench.core.errors import InputError
from tsbench.signs.rule_kinds import CROSSING, EDGE, LANE, ApproachParams, PlateParams, read_params

CONTRAST = "contrast"
# In a scene file between the name of a clause and its sign.
_AT = "@"


@dataclass(frozen=True)
class PassageParams(ApproachParams):
    """Of needless_stop and needless_yield: the way from `approach` to `exit` needs no waiting.

    main_in: edges into the junction between them whose vehicles have priority over the ego all the same, if one
    comes. crossing: the one between them that is passed, at most one; none: the junction is.
    """

    exit: str = field(metadata=EDGE)
    main_in: tuple[str, ...] = field(default=(), metadata=EDGE)
    crossing: tuple[str, ...] = field(default=(), metadata=CROSSING)

    def __post_init__(self) -> None:
        if len(self.crossing) > 1:
            raise ValueError(f"param 'crossing' must be one name at most, not {' '.join(self.crossing)!r}")


@dataclass(frozen=True)
class SlowZoneParams(PlateParams):
    """Of needless_slow: where there is no reason to drive slowly.

    zone_edges: in order. start_m, end_m: the zone, m from the start of the first of them, along the road and over the
    junctions between. limit_kmh: the lowest of the limits that bind there, the road's own among them.
    """

    zone_edges: tuple[str, ...] = field(metadata=EDGE)
    start_m: float
    end_m: float
    limit_kmh: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.start_m < self.end_m:
            raise ValueError(f"params 'start_m' and 'end_m': no zone from {self.start_m} to {self.end_m}")
        if not self.limit_kmh > 0.0:
            raise ValueError(f"param 'limit_kmh': {self.limit_kmh} is no speed")


@dataclass(frozen=True)
class WayParams(ApproachParams):
    """Of needless_detour: the way that the navigation gives and the plates permit.

    exits: allowed first edges behind the junction at the approach's end; none: any. lanes: those
    in which the ego is to stay on their edges; none: any.
    """

    exits: tuple[str, ...] = field(default=(), metadata=EDGE)
    lanes: tuple[str, ...] = field(default=(), metadata=LANE)

    def __post_init__(self) -> None:
        if not self.exits and not self.lanes:
            raise ValueError("params 'exits' and 'lanes': both are missing")


CLAUSES: Mapping[str, type[PlateParams]] = MappingProxyType(
    {
        "needless_stop": PassageParams,
        "needless_yield": PassageParams,
        "needless_slow": SlowZoneParams,
        "needless_detour": WayParams,
    }
)


@dataclass(frozen=True)
class ContrastClause:
    """One clause of a contrast scene.

    name: of CLAUSES. params: of the kind that this one has. sign: id of the target whose contrast plate it goes with;
    "": the first.
    """

    name: str
    params: PlateParams
    sign: str = ""

    def __post_init__(self) -> None:
        if self.name not in CLAUSES:
            raise ValueError(f"contrast clause {self.name!r} is none of {', '.join(CLAUSES)}")
        if type(self.params) is not CLAUSES[self.name]:
            raise ValueError(f"contrast clause {self.name!r}: carries {self.params}")


def contrast_to_poi(clause: ContrastClause, x: float, y: float) -> etree._Element:
    """The SUMO `<poi>` element of one clause, drawn at a place (m, of the network's frame)."""
    name = clause.name + (_AT + clause.sign if clause.sign else "")
    poi = etree.Element("poi", id=name, type=CONTRAST, color="magenta", layer="90", x=repr(float(x)), y=repr(float(y)))
    for key, text in clause.params.texts().items():
        etree.SubElement(poi, "param", key=key, value=text)
    return poi


def contrast_from_additional(root: etree._Element, source: str = "additional file") -> tuple[ContrastClause, ...]:
    """The clauses of a contrast scene, in the order of the file; none in every other scene.

    Raises InputError for a clause that there is not, or twice, and for params that it cannot use.
    """
    found: dict[str, ContrastClause] = {}
    for poi in root.iterfind(f"poi[@type='{CONTRAST}']"):
        there = poi.get("id", "")
        name, _, sign = there.partition(_AT)
        where = f"{source}: contrast clause {there!r}"
        kind = CLAUSES.get(name)
        if kind is None or there in found:
            problem = "occurs twice" if there in found else f"is none of {', '.join(CLAUSES)}"
            raise InputError(f"{where}: {problem}")
        given = {str(p.get("key")): str(p.get("value", "")) for p in poi.iterfind("param")}
        try:
            found[there] = ContrastClause(name, read_params(kind, given), sign)
        except ValueError as error:
            raise InputError(f"{where}: {error}") from error
    return tuple(found.values())
