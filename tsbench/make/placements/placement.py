"""What a placement is, and the users of a lane that several of them hold until the ego comes. Units: m, s, m/s, rad.

Each type's placement decides where its plates stand, by distances of its recipe; `plate_beside` gives the pose of one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from tsbench.make.maps.plain import PlainNet
from tsbench.make.scenes.recipe import Recipe, Variant
from tsbench.make.scenes.traffic import Driver
from tsbench.roads.lane_graph import Destination, LaneGraph, Turn
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import ALL_LANES, DISTRACTOR, TARGET, SignInstance
from tsbench.signs.contrast import ContrastClause
from tsbench.signs.rule_kinds import PlateParams
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart, Obstacle, WalkersPlan
from tsbench.sim.world import EGO_LENGTH_M

PLATE_BESIDE_M = 1.2
# Room between the end of a lane and a body that stands on it.
_END_ROOM_M = 1.0
# On a shorter way from its stand the lead could not be timed.
_LEAST_WAY_M = 5.0
# IDM drives off at about this share of its largest acceleration.
_START_SHARE = 0.8


class UnfitMapError(Exception):
    """This map can't carry the type; the message is the reason that is kept."""


class UnluckyDrawError(UnfitMapError):
    """This draw of a variant came to nothing; another one may."""


@dataclass(frozen=True)
class ConvoySetup:
    """A convoy before its lead was timed. `places`: fronts on `lane` (id), lead first; `edges`: its route.

    lanes: where the cars behind the lead stand on other lanes than it, the lane of each; `edges` then begins with the
    last one's, and each drives on from its own.
    The lead is the one that the ego meets first; `vclass` is SUMO's class of them all. zone_m: along the lead's path
    from the start of `lane` to the conflict zone. line_lane, ego_zone_m, ego_cruise_mps, ego_turn_mps: as in
    sim.scene.ConvoyPlan; so are after_s and keeps_back. abrupt: they brake no sooner than they must. departs: when each
    enters at the start of `lane`, at its cruise speed (s; an episode's release moves all of them alike); (): they stand
    there.
    """

    drivers: tuple[Driver, ...]
    places: tuple[float, ...]
    lane: str
    edges: tuple[str, ...]
    zone_m: float
    line_lane: str
    ego_zone_m: float
    ego_cruise_mps: float
    ego_turn_mps: float
    vclass: str = "passenger"
    lanes: tuple[str, ...] = ()
    after_s: float = 0.0
    keeps_back: bool = False
    abrupt: bool = False
    departs: tuple[float, ...] = ()


@dataclass(frozen=True)
class Arrangement:
    """One scene, decided but not yet written.

    extra: further SUMO elements. avoid_turns: where other traffic is not sent.
    quiet_edges, blocked: edges, and stretches (lane id, from, to in m), where no car stands at first.
    closed_edges: without any other traffic; no length of theirs counts for the density. quiet_s: until then
    no vehicle enters the scene.
    drivers: the background drivers where the scene needs others, () = the task's. platoons: edges where cars enter in
    platoons. walkers: the plan of pedestrians who stand in `extra`. contrast: in a contrast half, what is asked beside
    the target's rule.
    """

    signs: tuple[SignInstance, ...]
    targets: tuple[str, ...]
    start: EgoStart
    destination: Destination
    route_hint: tuple[str, ...]
    compliant_hint: tuple[str, ...] = ()
    route_length: float = float("nan")
    obstacles: tuple[Obstacle, ...] = ()
    convoy: ConvoySetup | None = None
    extra: tuple[etree._Element, ...] = ()
    avoid_turns: AbstractSet[Turn] = frozenset()
    quiet_edges: AbstractSet[str] = frozenset()
    closed_edges: AbstractSet[str] = frozenset()
    drivers: tuple[Driver, ...] = ()
    blocked: tuple[tuple[str, float, float], ...] = ()
    platoons: AbstractSet[str] = frozenset()
    walkers: WalkersPlan | None = None
    contrast: tuple[ContrastClause, ...] = ()
    quiet_s: float = 0.0


@dataclass(frozen=True)
class SceneTask:
    """What a placement works with: the map and its finished network, the recipe, the variant, and its draws."""

    row: PoolRow
    network: RoadNetwork
    graph: LaneGraph
    recipe: Recipe
    variant: Variant
    drivers: tuple[Driver, ...]
    rng: np.random.Generator


class ScenePlacement(ABC):
    """How one type is laid out: the network's edits once per map, then both halves of each variant.

    code: of the target's plate.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    @abstractmethod
    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The crop with what the plates mean to other traffic. Raises UnfitMapError."""

    @abstractmethod
    def place(self, task: SceneTask) -> Arrangement:
        """One variant's scene. Raises UnfitMapError."""

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The crop with what the contrast half's plates mean to other traffic: by default the same. UnfitMapError."""
        return self.prepare(row, plain, recipe)

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The other half of a variant's pair on its own network, None where the type has no pairs. UnfitMapError.

        Start, destination, hint, obstacles and who else is there stay those of `signed`, and so do the posts, of
        which only the plates differ: a planner that is not told the plates cannot tell the halves apart.
        """
        del task, signed
        return None


def plate_beside(
    network: RoadNetwork,
    code: str,
    edge: str,
    s: float,
    params: PlateParams | None = None,
    *,
    number: int = 0,
    role: str = "target",
    value: float | None = None,
    lane: int = ALL_LANES,
    ends: str | None = None,
) -> SignInstance:
    """The scene's plate of that number, with its post right of the rightmost lane at `s` m along an edge."""
    right = network.edge_lanes(edge)[0]
    x, y = right.line.point_at(s, -(right.width / 2 + PLATE_BESIDE_M))
    heading = right.line.heading_at(s)
    return SignInstance(
        id=f"sign_{number}", code=code, value=value, edge=edge, lane=lane, position_m=s, x=x, y=y, heading=heading,
        role=role, ends=ends, params=params,
    )  # fmt: skip


def usual_limit(task: SceneTask, code: str, at: tuple[str, float], edges: Sequence[str]) -> SignInstance:
    """The scene's second plate, beside an edge at so many m: a limit that some edges may have, closest to their own.

    Of those that their classes of road may have, the least that is no lower, else the highest. Raises UnfitMapError.
    """
    network = task.network
    own = max(lane.speed for edge in edges for lane in passenger_lanes(network, edge)) * 3.6
    posted, catalog = task.recipe.catalog.sign(code).value, task.recipe.catalog
    values = () if posted is None else posted.allowed
    for edge in edges:
        allowed = catalog.allowed_speeds(road_class=network.edges[edge].road_class, code=code)
        values = tuple(v for v in values if allowed is None or v in allowed)
    require(bool(values), f"no {code} can stand there")
    value = float(min((v for v in values if v >= own - 0.5), default=max(values)))
    return plate_beside(network, code, *at, number=1, role=DISTRACTOR, value=value)


def exchanged(plate: SignInstance, other: SignInstance) -> tuple[SignInstance, SignInstance]:
    """The plates of two posts, which change places: the target's, without a value, and one that binds no vehicle."""
    free = replace(plate, code=other.code, value=other.value, lane=other.lane, role=DISTRACTOR, params=None)
    return free, replace(other, code=plate.code, value=None, lane=plate.lane, role=TARGET)


def turns_into(graph: LaneGraph, edges: AbstractSet[str]) -> set[Turn]:
    """All turns by which some edges are entered."""
    return {(edge, e) for e in edges for edge in graph.network.edges if e in graph.successors(edge)}


def passenger_lanes(network: RoadNetwork, edge: str) -> tuple[Lane, ...]:
    """Lanes of an edge that cars may use, rightmost first."""
    return tuple(lane for lane in network.edge_lanes(edge) if lane.permits("passenger"))


def start_speed(task: SceneTask, lane: Lane) -> float:
    """The variant's initial speed, m/s: at most the limit that planners are shown, and the one SUMO departs with."""
    return min(task.variant.initial_speed, task.network.shown_limits[lane.index], lane.speed)


def before_line(lane: Lane, distance: float) -> float:
    """Arc length of the ego's centre whose front is `distance` before the end of a lane. Raises UnfitMapError."""
    s = lane.line.length - distance - EGO_LENGTH_M / 2
    if s < EGO_LENGTH_M / 2:
        raise UnfitMapError(
            f"lane {lane.id} of {lane.line.length:.0f} m has no room for the ego {distance:.0f} m before it"
        )
    return s


def keep_clear(lanes: Sequence[Lane], start: EgoStart) -> tuple[tuple[str, float, float], ...]:
    """The stretch from the ego to the end of its edge, on all its lanes: the ego is the first at the sign."""
    return tuple((lane.id, start.s, lane.line.length) for lane in lanes)


def require(condition: bool, reason: str) -> None:
    """Raise UnfitMapError with the reason unless the condition holds."""
    if not condition:
        raise UnfitMapError(reason)


def lane_users(
    task: SceneTask, vclass: str, lane: Lane, edges: tuple[str, ...], before: Lane, start: EgoStart, across: float
) -> ConvoySetup:
    """The users of `lane`, who then drive over `edges`; `before`: the ego's lane, `across` from its end to theirs.

    They come towards the ego, close behind one another, and meet it front to front a little way along their lane.
    Raises UnfitMapError.
    """
    recipe, variant = task.recipe, task.variant
    driver = user_driver(recipe)
    length_m = lane.line.length
    meet = min(recipe.number("meet_m"), recipe.number("meet_share") * length_m)
    to_line = before.line.length - start.s - EGO_LENGTH_M / 2
    eta = predicted_arrival(to_line, to_line + across + meet, start.speed, before.speed, before.speed)
    zone = length_m - meet
    way = way_from_standstill(driver, recipe.number("user_time_share") * eta)
    first = driver.length + _END_ROOM_M
    lead = max(zone - way, first)
    step = -(driver.length + recipe.number("standing_gap_m"))
    counts = recipe.choices["users"]
    asked = int(counts[variant.layout % len(counts)])
    wanted = [lead + k * step for k in range(asked)]
    places = tuple(p for p in wanted if first <= p <= length_m - _END_ROOM_M)
    require(bool(places) and zone - lead >= _LEAST_WAY_M, f"the reserved lane is {length_m:.0f} m long")
    return ConvoySetup(
        drivers=(driver,) * len(places), places=places, lane=lane.id, edges=edges, zone_m=zone, line_lane=before.id,
        ego_zone_m=across + meet, ego_cruise_mps=before.speed, ego_turn_mps=before.speed, vclass=vclass,
    )  # fmt: skip


def user_driver(recipe: Recipe) -> Driver:
    """The recipe's bus or cyclist. Its headway is from front to front, IDM's is the gap: less its own length."""
    speed, length, gap = (recipe.number(f"user_{k}") for k in ("speed_mps", "length_m", "gap_m"))
    return Driver(
        speed=speed,
        accel=recipe.number("user_accel_mps2"),
        decel=recipe.number("user_decel_mps2"),
        headway=recipe.number("user_headway_s") - (length + gap) / speed,
        gap=gap,
        length=length,
        width=recipe.number("user_width_m"),
    )


def way_from_standstill(driver: Driver, time: float) -> float:
    """How far a vehicle gets in a time (s): a ramp, then its cruise speed."""
    accel = _START_SHARE * driver.accel
    ramp = driver.speed / accel
    if time <= ramp:
        return 0.5 * accel * time * time
    return 0.5 * driver.speed * ramp + driver.speed * (time - ramp)
