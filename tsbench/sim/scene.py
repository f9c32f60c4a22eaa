"""A scene: everything of an episode that does not move. Read from the network and the additional file."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field, fields
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.roads.destination import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plate_params import NAMES, GiveWayParams, JunctionParams, ZoneParams


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
class ConvoyPlan:
    """Vehicles held until their lead would reach the conflict zone together with the ego.

    vehicles: SUMO ids, lead first. line_lane: lane id whose end is the ego's line. ego_zone_m: from that line to the
    zone along the ego's nominal path. lead_time_s: from standing start to the zone, measured when the scene was built.
    ego_cruise_mps, ego_turn_mps: what the prediction lets the ego accelerate to, and its speed at the line.
    """

    vehicles: tuple[str, ...]
    line_lane: str
    ego_zone_m: float
    lead_time_s: float
    ego_cruise_mps: float
    ego_turn_mps: float


@dataclass(frozen=True, slots=True)
class WalkersPlan:
    """Pedestrians held until the first of them would meet the ego at their crossing; then all set off.

    persons: SUMO ids. speeds: m/s, by person. line_lane, ego_cruise_mps, ego_turn_mps: as of a convoy. ego_zone_m: from
    that line to the crossing. lead_time_s: from the release until the first is where it would meet the ego.
    """

    persons: tuple[str, ...]
    speeds: tuple[float, ...]
    line_lane: str
    ego_zone_m: float
    lead_time_s: float
    ego_cruise_mps: float
    ego_turn_mps: float


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A file of a scene: where it was found (in a store: the store's path, then its name) and its plain content."""

    path: Path
    content: bytes = field(repr=False)

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class Scene:
    """A loaded scene. `target` is the id of the sign that the scenario is about; `horizon` in steps.

    route_hint: edges of the way that navigation gives at the start; compliant_hint: of an obedient way, where it
    is another one. Both are for lint and pictures; no planner sees them.
    Raises InputError where a plate's params name what is not there, or what does not fit its place.
    """

    net: SceneFile
    additional: SceneFile
    network: RoadNetwork
    signs: tuple[SignInstance, ...]
    target: str
    obstacles: tuple[Obstacle, ...]
    start: EgoStart
    destination: Destination
    convoy: ConvoyPlan | None
    horizon: int
    seed: int
    route_hint: tuple[str, ...] = ()
    compliant_hint: tuple[str, ...] = ()
    walkers: WalkersPlan | None = None

    def __post_init__(self) -> None:
        for sign in self.signs:
            problem = self._problem(sign)
            if problem is not None:
                raise InputError(f"{self.additional}: sign {sign.id!r}: {problem}")

    def _problem(self, sign: SignInstance) -> str | None:
        """What makes a plate's params impossible on this map, in words."""
        params, network = sign.params, self.network
        if params is None:
            return None
        known: dict[str, Container[str]] = {
            "edge": network.edges, "lane": network.lane_index, "junction": network.junctions,
            "crossing": network.crossings, "obstacle": {o.id for o in self.obstacles},
        }  # fmt: skip
        for param in fields(params):
            what = param.metadata[NAMES]
            for name in params.named()[param.name]:
                if name not in known[what]:
                    return f"param {param.name!r}: no {what} {name!r}"
        if isinstance(params, JunctionParams):
            into = (params.approach, *(params.main_in if isinstance(params, GiveWayParams) else ()))
            for edge in into:
                if network.edges[edge].target != params.junction:
                    return f"edge {edge!r} does not lead to junction {params.junction!r}"
        if isinstance(params, ZoneParams) and params.zone_edges[0] != sign.edge:
            return f"stands on edge {sign.edge!r}, but its zone starts with {params.zone_edges[0]!r}"
        return None

    @property
    def target_sign(self) -> SignInstance:
        """The sign that the scenario is about."""
        return next(s for s in self.signs if s.id == self.target)
