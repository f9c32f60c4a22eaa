"""A scene: everything of an episode that does not move. Read from the network and the additional file."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field, fields
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.catalog import Catalog, RuleSpec
from tsbench.signs.contrast import ContrastClause, PassageParams
from tsbench.signs.countries import Artwork, Country
from tsbench.signs.rule_kinds import NAMES, GiveWayParams, JunctionParams, PlateParams, ZoneParams


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A fixed thing on the road as an oriented box (centre, rad, m); `lane`: SUMO lane id; `shape`: cones | island."""

    id: str
    shape: str
    x: float
    y: float
    heading: float
    length: float
    width: float
    lane: str


@dataclass(frozen=True, slots=True)
class EgoStart:
    """Where the ego's *centre* starts: SUMO lane id, arc length along its centre line (m), speed (m/s)."""

    lane: str
    s: float
    speed: float


@dataclass(frozen=True, slots=True)
class ReleasePlan:
    """Road users held until their first would reach the conflict zone together with the ego; then all set off.

    line_lane: lane id whose end is the ego's line. ego_zone_m: from that line to the zone along the ego's nominal path.
    lead_time_s: from the release until the first is there. ego_cruise_mps, ego_turn_mps: what the prediction lets the
    ego accelerate to, and its speed at the line.
    """

    line_lane: str
    ego_zone_m: float
    lead_time_s: float
    ego_cruise_mps: float
    ego_turn_mps: float

    @property
    def ahead_s(self) -> float:
        """So long before the ego's arrival at the zone they set off."""
        return self.lead_time_s


@dataclass(frozen=True, slots=True)
class ConvoyPlan(ReleasePlan):
    """vehicles: SUMO ids, lead first. Their lead's time was measured when the scene was built.

    after_s: so much later than the ego the lead reaches the zone. keeps_back: it slows down with an ego that is slow
    near its line (`sim.junction_traffic`), as it does not in the scenes of 2026.3.
    """

    vehicles: tuple[str, ...]
    after_s: float = 0.0
    keeps_back: bool = False

    @property
    def ahead_s(self) -> float:
        """So long before the ego's arrival at the zone they set off."""
        return self.lead_time_s - self.after_s


@dataclass(frozen=True, slots=True)
class WalkersPlan(ReleasePlan):
    """Pedestrians, whose zone is their crossing. persons: SUMO ids. speeds: m/s, by person.

    come_up_s: so long they walk from the start, up to the kerb, where they wait for their release. until_past: they let
    the ego pass; it releases them where it has left the junction with the crossing.
    """

    persons: tuple[str, ...]
    speeds: tuple[float, ...]
    come_up_s: float = 0.0
    until_past: bool = False


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A file of a scene: where it was found (in a store: the store's path, then its name) and its plain content."""

    path: Path
    content: bytes = field(repr=False)

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class SceneLayout:
    """What a recipe decides of a scene, and its additional file says.

    targets: ids of the signs that the scenario is about. route_hint: edges of the way that navigation gives at the
    start; compliant_hint: of an obedient way, where it is another one. Both are for lint and pictures; no planner sees
    them. contrast: what is asked beside the targets' rules in a contrast scene, where a target may bind nobody; else
    none.
    """

    signs: tuple[SignInstance, ...]
    targets: tuple[str, ...]
    obstacles: tuple[Obstacle, ...]
    start: EgoStart
    destination: Destination
    convoy: ConvoyPlan | None = None
    route_hint: tuple[str, ...] = ()
    compliant_hint: tuple[str, ...] = ()
    walkers: WalkersPlan | None = None
    contrast: tuple[ContrastClause, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Scene(SceneLayout):
    """A layout on its network. horizon: steps. catalog: what its plates ask. city: whose data set has it.

    Raises InputError where the layout or a plate's params name what is not there, or what does not fit its place.
    """

    net: SceneFile
    additional: SceneFile
    network: RoadNetwork
    horizon: int
    seed: int
    catalog: Catalog = field(compare=False, repr=False)
    city: str = OWN_CITY

    def __post_init__(self) -> None:
        self._check_places()
        parts: list[tuple[str, str, PlateParams | None]] = [(f"sign {s.id!r}", s.edge, s.params) for s in self.signs]
        parts += [(f"contrast clause {c.name!r}", "", c.params) for c in self.contrast]
        for what, edge, params in parts:
            problem = None if params is None else self._problem(params) or self._misfit(params, edge)
            if problem is not None:
                raise InputError(f"{self.additional}: {what}: {problem}")

    def artwork(self, country: Country | None = None) -> Artwork:
        """How its plates look: as in its city, or in the country that a user asks for."""
        return Artwork.of(self.catalog, self.city, country)

    def _check_places(self) -> None:
        plans = {"convoy": self.convoy, "walkers": self.walkers}
        lanes = {"start": self.start.lane} | {what: plan.line_lane for what, plan in plans.items() if plan}
        lanes |= {f"obstacle {o.id}": o.lane for o in self.obstacles}
        for what, lane in lanes.items():
            if lane not in self.network.lane_index:
                raise InputError(f"{self.additional}: {what}: no lane {lane!r} in the network")
        edges = {"destination": self.destination.edge} | {f"sign {s.id}": s.edge for s in self.signs}
        for what, edge in edges.items():
            if edge not in self.network.edges:
                raise InputError(f"{self.additional}: {what}: no edge {edge!r} in the network")
        for sign in self.signs:
            if sign.lane >= len(self.network.edges[sign.edge].lanes):
                raise InputError(f"{self.additional}: sign {sign.id}: edge {sign.edge!r} has no lane {sign.lane}")

    def _problem(self, params: PlateParams) -> str | None:
        """Which name in some params is that of nothing in this scene, in words."""
        network = self.network
        known: dict[str, Container[str]] = {
            "edge": network.edges,
            "lane": network.lane_index,
            "junction": network.junctions,
            "crossing": network.crossings,
        }
        known["obstacle"] = {o.id for o in self.obstacles}
        kinds = {f.name: f.metadata.get(NAMES, "") for f in fields(params)}
        for key, names in params.named().items():
            for name in names:
                if name not in known[kinds[key]]:
                    return f"param {key!r}: no {kinds[key]} {name!r}"
        return None

    def _misfit(self, params: PlateParams, edge: str) -> str | None:
        """What makes some params impossible on this map, and at a plate on `edge`, in words."""
        edges = self.network.edges
        if isinstance(params, ZoneParams) and params.zone_edges[0] != edge:
            return f"stands on edge {edge!r}, but its zone starts with {params.zone_edges[0]!r}"
        if not isinstance(params, JunctionParams | PassageParams):
            return None
        node = params.junction if isinstance(params, JunctionParams) else edges[params.approach].target
        main_in = params.main_in if isinstance(params, GiveWayParams | PassageParams) else ()
        for one in (params.approach, *main_in):
            if edges[one].target != node:
                return f"edge {one!r} does not lead to junction {node!r}"
        if isinstance(params, PassageParams) and edges[params.exit].source != node:
            return f"edge {params.exit!r} does not lead away from junction {node!r}"
        return None

    def check_codes(self, code: str, where: str) -> None:
        """InputError where a plate that is no distractor cannot stand with the targets. code: the first one's."""
        plates = {sign.id: sign.code for sign in self.signs if sign.role != DISTRACTOR}
        self.catalog.check_plates((code, *(sign.code for sign in self.target_signs[1:])), plates, where)

    def rule(self, sign: SignInstance) -> RuleSpec:
        """What a plate of it asks."""
        return self.catalog.sign(sign.code).rule

    def plates(self, *rules: str) -> list[SignInstance]:
        """Its plates of rules."""
        return [sign for sign in self.signs if self.rule(sign).name in rules]

    @property
    def target_signs(self) -> tuple[SignInstance, ...]:
        """The signs that the scenario is about, in the order of its type."""
        return tuple(self.sign(name) for name in self.targets)

    def sign(self, name: str) -> SignInstance:
        """The plate of an id."""
        return next(sign for sign in self.signs if sign.id == name)
