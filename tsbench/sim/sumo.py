"""The only module that talks to SUMO. One simulation per process; SUMO's angles and front positions end here.

Facts that this rests on were measured (docs/footguns.md): on the small maps here plain getters read the world at a
third of the cost of a context subscription; a state is never saved and resumed; every float is checked before it
reaches `moveToXY`, which makes a vehicle with NaN vanish without a word.
"""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import libsumo
import numpy as np

from tsbench.core.benchmark import ROAD_USER_RANGE_M
from tsbench.core.errors import SimulationError
from tsbench.roads.network import RoadNetwork
from tsbench.sim.ego import Motion
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import DT_S, EGO_LENGTH_M, ActorKind, Actors, ActorTable, Box

OBSTACLE_PREFIX = "obstacle"

_SUMO_ERRORS = (libsumo.TraCIException, libsumo.FatalTraCIError, RuntimeError)
# keepRoute of moveToXY: off the road too (2), and on lanes that the ego may not use (4), or nobody there would see it.
_ANYWHERE = 2 | 4
_RAD_PER_DEGREE = math.pi / 180.0
# SUMO's speed modes: all checks, and all but those of the right of way at junctions.
_OWN_SPEED, _NO_PRIORITY = 31, 7
# More than any car here gains in a step.
_SPEED_UP_MPS = 0.5
_KINDS = {"bus": ActorKind.BUS, "coach": ActorKind.BUS, "bicycle": ActorKind.BICYCLE}
_OPTIONS = shlex.split(
    f"--step-length {DT_S} --no-step-log true --no-warnings true --duration-log.disable true --time-to-teleport -1 "
    "--collision.action none --default.speeddev 0 --xml-validation never --xml-validation.net never "
    "--max-depart-delay 5 --ignore-route-errors false --pedestrian.striping.dawdling 0"
)


# What stays the same of a road user: id, row in the table, half its length, length, width.
_Body = tuple[str, int, float, float, float]


class _Sight:
    """Road users in sight, collected as plain numbers: at ten of them arrays cost more than they save."""

    __slots__ = ("boxes", "lanes", "places", "poses", "rows", "speeds")

    def __init__(self) -> None:
        self.rows: list[int] = []
        self.boxes: list[Box] = []
        self.poses: list[tuple[float, float, float]] = []
        self.speeds: list[float] = []
        self.lanes: list[int] = []
        self.places: list[float] = []

    def actors(self, table: ActorTable) -> Actors:
        """As arrays. Planners get these very arrays: the record of what happened is read-only."""
        index, lane = np.array(self.rows, dtype=np.int32), np.array(self.lanes, dtype=np.int32)
        pose = np.array(self.poses, dtype=np.float64).reshape(-1, 3)
        speed, place = np.array(self.speeds, dtype=np.float64), np.array(self.places, dtype=np.float64)
        for array in (index, pose, speed, lane, place):
            array.setflags(write=False)
        return Actors(table, index, pose, speed, lane, place, tuple(self.boxes))


@contextmanager
def _in_memory(content: bytes) -> Iterator[str]:
    """A path by which SUMO, in this process, can read `content`: gone with the block, or with the process."""
    file = os.memfd_create("scene.xml")
    try:
        # A write into memory is whole, or raises.
        os.write(file, content)
        yield f"/proc/self/fd/{file}"
    finally:
        os.close(file)


class _Library:
    """libsumo's state is process-wide: this is what outlives a `Simulation`.

    holder: the owner of the loaded scene, or None. placed: a move that no step has carried out.
    """

    holder: Simulation | None = None
    placed = False

    def settle(self) -> None:
        """Carry out a move that is left: it would outlive its simulation and crash the next one."""
        if self.placed:
            self.placed = False
            libsumo.simulationStep()


_LIBRARY = _Library()


class Simulation:
    """SUMO with one scene at a time. `load_scene`, then `place_ego` and `step` in turn, then `actors`.

    A process has one scene at a time too: where another `Simulation` has loaded one, `step` and `place_ego` of this one
    raise SimulationError until it loads again.
    """

    def __init__(self) -> None:
        self._table = ActorTable()
        self._lane_index: Mapping[str, int] = {}
        self._seen: tuple[str, ...] = ()
        self._kept: list[_Body] = []
        self._bodies: dict[str, _Body] = {}
        self._persons: tuple[str, ...] = ()
        self._ego_there = False
        self._ego_front = (0.0, 0.0)

    def load_scene(self, scene: Scene, additional_content: bytes | None = None) -> None:
        """Load a scene. Raises SimulationError where SUMO refuses it (its words are on stderr).

        additional_content: in place of its additional file's.
        """
        content = scene.additional.content if additional_content is None else additional_content
        with _in_memory(scene.net.content) as net, _in_memory(content) as additional:
            self._load(net, additional, scene.network, scene.seed, scene.additional.path)

    def load(self, net: Path, additional: Path, network: RoadNetwork, seed: int) -> None:
        """Load files of a scene that is being built; raises as `load_scene` does."""
        self._load(str(net), str(additional), network, seed, additional)

    def _load(self, net: str, additional: str, network: RoadNetwork, seed: int, where: Path) -> None:
        options = ["-n", net, "-a", additional, "--seed", str(seed & 0x7FFFFFFF), *_OPTIONS]
        try:
            _LIBRARY.settle()
            if _LIBRARY.holder is not None:
                libsumo.load(options)
            else:
                libsumo.start(["sumo", *options])
            _LIBRARY.holder = self
        except _SUMO_ERRORS as error:
            _LIBRARY.holder = None
            raise SimulationError(f"{where}: SUMO does not load the scene ({error})") from error
        self._lane_index = network.lane_index
        self._table = ActorTable()
        self._bodies = {}
        self._seen = ()
        self._persons = ()

    @property
    def table(self) -> ActorTable:
        """The road users of the scene that was loaded last."""
        return self._table

    def holds(self, table: ActorTable) -> bool:
        """Is the scene with these road users the one in SUMO?"""
        return _LIBRARY.holder is self and self._table is table

    def start_ego(self, motion: Motion, edge: str, lane_order: int) -> None:
        """First step: SUMO inserts what departs at time 0; then the ego is taken over."""
        self.step()
        if EGO_ID not in libsumo.vehicle.getIDList():
            raise SimulationError("SUMO did not insert the ego at its start")
        libsumo.vehicle.setSpeedMode(EGO_ID, 0)
        libsumo.vehicle.setLaneChangeMode(EGO_ID, 0)
        self.place_ego(motion, edge, lane_order)

    def place_ego(self, m: Motion, edge: str, lane_order: int) -> None:
        """Put the ego where its own motion says; `edge` and `lane_order` ("" and -1 where unknown) are only a hint."""
        self._check_holder()
        half = EGO_LENGTH_M / 2
        x, y = m.x + half * math.cos(m.heading), m.y + half * math.sin(m.heading)
        if not math.isfinite(x + y + m.speed):
            raise SimulationError(f"the ego's pose is not finite ({m})")
        libsumo.vehicle.moveToXY(EGO_ID, edge, lane_order, x, y, 90.0 - math.degrees(m.heading), _ANYWHERE)
        libsumo.vehicle.setPreviousSpeed(EGO_ID, m.speed)
        self._ego_front = (x, y)
        _LIBRARY.placed = True

    def step(self) -> None:
        self._check_holder()
        _LIBRARY.placed = False
        try:
            libsumo.simulationStep()
        except _SUMO_ERRORS as error:
            raise SimulationError(f"SUMO broke off at {libsumo.simulation.getTime():.1f} s ({error})") from error

    def set_route(self, edges: tuple[str, ...]) -> bool:
        """Tell SUMO where the ego is going, so that traffic sees it at junctions.

        Returns False, and changes nothing, while SUMO has the ego on none of these edges (inside a junction, say).
        Raises SimulationError for edges that do not connect.
        """
        # Not the edge that it is seen on: SUMO's own place on its route lags behind that where edges are short.
        here = libsumo.vehicle.getRoute(EGO_ID)[max(libsumo.vehicle.getRouteIndex(EGO_ID), 0)]
        if here not in edges or libsumo.vehicle.getRoadID(EGO_ID) not in edges:
            return False
        try:
            libsumo.vehicle.setRoute(EGO_ID, edges[edges.index(here) :])
        except _SUMO_ERRORS as error:
            raise SimulationError(f"no way over {' > '.join(edges)} ({error})") from error
        return True

    def hold(self, vehicle: str) -> None:
        """Keep a vehicle standing, and for good in the lane that its part in the scene asks for."""
        libsumo.vehicle.setLaneChangeMode(vehicle, 0)
        libsumo.vehicle.setSpeed(vehicle, 0.0)

    def release(self, vehicle: str, heeds_priority: bool = True) -> None:
        """Give a held vehicle back to its own driver. heeds_priority: does it look at the right of way?"""
        libsumo.vehicle.setSpeedMode(vehicle, _OWN_SPEED if heeds_priority else _NO_PRIORITY)
        libsumo.vehicle.setSpeed(vehicle, -1.0)

    def to_lane_end(self, vehicle: str) -> float:
        """Metres from a vehicle's front to the end of its lane."""
        v = libsumo.vehicle
        return float(libsumo.lane.getLength(v.getLaneID(vehicle)) - v.getLanePosition(vehicle))

    def entry(self, vtype: str, edge: str, lane_order: int) -> tuple[float, float]:
        """Metres to the lane's end, and speed (m/s), of a vehicle of this type that enters at the lane's start."""
        lane, kind = f"{edge}_{lane_order}", libsumo.vehicletype
        room = libsumo.lane.getLength(lane) - kind.getLength(vtype)
        return float(room), float(min(kind.getMaxSpeed(vtype), libsumo.lane.getMaxSpeed(lane)))

    def speed(self, vehicle: str) -> float:
        """A vehicle's speed, m/s."""
        return float(libsumo.vehicle.getSpeed(vehicle))

    def pace(self, vehicle: str) -> tuple[float, float]:
        """What a vehicle speeds up to on its own where it is now (m/s), and with what acceleration (m/s2)."""
        v = libsumo.vehicle
        return float(min(v.getMaxSpeed(vehicle), v.getAllowedSpeed(vehicle))), float(v.getAccel(vehicle))

    def set_pace(self, vehicle: str, speed: float, accel: float) -> None:
        """From now a vehicle speeds up to this (m/s) on any road, with this acceleration (m/s2)."""
        v = libsumo.vehicle
        v.setMaxSpeed(vehicle, speed)
        v.setSpeedFactor(vehicle, max(1.0, speed / libsumo.lane.getMaxSpeed(v.getLaneID(vehicle))))
        v.setAccel(vehicle, accel)

    def stop_before_end(self, vehicle: str, before_m: float, brake_mps2: float, top_mps: float) -> None:
        """Slow a vehicle where it must, so that its front stops `before_m` before its lane's end. Each step anew.

        top_mps: down to that speed in any case.
        """
        v = libsumo.vehicle
        room = self.to_lane_end(vehicle) - before_m
        # The speed after this step with which it still stops in time, at a constant deceleration.
        step = brake_mps2 * DT_S
        speed = v.getSpeed(vehicle)
        most = math.sqrt(step * step / 4.0 + 2.0 * brake_mps2 * max(room, 0.0)) - step / 2.0
        most = min(most, max(top_mps, speed - step))
        v.setSpeed(vehicle, most if speed + _SPEED_UP_MPS > most else -1.0)

    def is_there(self, vehicle: str) -> bool:
        """Is the vehicle on the road?"""
        return vehicle in libsumo.vehicle.getIDList()

    def time(self) -> float:
        """SUMO's clock, s."""
        return float(libsumo.simulation.getTime())

    def hold_persons(self, persons: tuple[str, ...]) -> None:
        """Keep pedestrians standing where they are put in, whatever wait the scene gives them; they are seen from now.

        Raises SimulationError for one that is not there.
        """
        there = libsumo.person.getIDList()
        for person in persons:
            if person not in there:
                raise SimulationError(f"SUMO did not insert pedestrian {person}")
            while libsumo.person.getStage(person).type != libsumo.STAGE_WALKING:
                libsumo.person.removeStage(person, 0)
            libsumo.person.setSpeed(person, 0.0)
        self._persons = tuple(sorted(persons))

    def let_walk(self, person: str, speed: float) -> None:
        if person in libsumo.person.getIDList():
            libsumo.person.setSpeed(person, speed)

    def fleet(self) -> list[tuple[str, str, float]]:
        """All vehicles on the road, sorted by id: (id, lane id, front's place along it in m)."""
        lane, place = libsumo.vehicle.getLaneID, libsumo.vehicle.getLanePosition
        return [(i, lane(i), place(i)) for i in sorted(libsumo.vehicle.getIDList())]

    def speeds(self, prefix: str) -> list[float]:
        """Speeds (m/s) of all vehicles on the road whose ids begin with `prefix`, in the order of the ids."""
        speed = libsumo.vehicle.getSpeed
        return [speed(i) for i in sorted(libsumo.vehicle.getIDList()) if i.startswith(prefix)]

    def add_car(
        self, vehicle: str, vtype: str, edges: tuple[str, ...], lane_order: int, at_s: float | None = None
    ) -> None:
        """Let a car of a loaded type in at the start of its first edge, as fast as is safe.

        at_s: when, of SUMO's clock; None: now.
        """
        libsumo.route.add(f"{vehicle}_route", edges)
        depart = {"departLane": str(lane_order), "departPos": "base", "departSpeed": "max"}
        if at_s is not None:
            depart["depart"] = repr(at_s)
        libsumo.vehicle.add(vehicle, f"{vehicle}_route", vtype, **depart)

    def distance_driven(self, vehicle: str) -> float:
        """Metres since its departure, its start position included."""
        return float(libsumo.vehicle.getDistance(vehicle))

    def _enter(self, name: str, kind: ActorKind, length: float, width: float, route: tuple[str, ...]) -> _Body:
        row = self._table.add(name, kind, length, width, route)
        body = self._bodies[name] = (name, row, length * 0.5, length, width)
        return body

    def _vehicle(self, name: str) -> _Body:
        v = libsumo.vehicle
        kind = _KINDS.get(v.getVehicleClass(name), ActorKind.CAR)
        return self._enter(name, kind, v.getLength(name), v.getWidth(name), tuple(v.getRoute(name)))

    def _remember(self, ids: tuple[str, ...]) -> None:
        """Which vehicles are on the road, until that changes."""
        known = self._bodies
        kept = sorted(i for i in ids if i != EGO_ID and not i.startswith(OBSTACLE_PREFIX))
        self._kept = [known[i] if i in known else self._vehicle(i) for i in kept]
        self._seen = ids
        self._ego_there = EGO_ID in ids

    def actors(self) -> Actors | None:
        """Road users within 120 m of the ego; None if the ego has left the map."""
        ids = libsumo.vehicle.getIDList()
        if ids != self._seen:
            self._remember(ids)
        if not self._ego_there:
            return None
        sight = _Sight()
        self._look(libsumo.vehicle, self._kept, sight)
        if self._persons:
            self._look(libsumo.person, self._walkers(), sight)
        return sight.actors(self._table)

    def _walkers(self) -> list[_Body]:
        """Pedestrians of the scene who are there and in sight."""
        p, known = libsumo.person, self._bodies
        there = frozenset(p.getIDList())
        near = [
            i for i in self._persons if i in there and math.dist(p.getPosition(i), self._ego_front) <= ROAD_USER_RANGE_M
        ]
        return [
            known[i] if i in known else self._enter(i, ActorKind.PEDESTRIAN, p.getLength(i), p.getWidth(i), ())
            for i in near
        ]

    def _look(self, domain: type[libsumo.vehicle] | type[libsumo.person], bodies: list[_Body], sight: _Sight) -> None:
        """Read where these are; those farther than 120 m from the ego's front are left out."""
        position, angle = domain.getPosition, domain.getAngle
        speed, place = domain.getSpeed, domain.getLanePosition
        lane_of, lanes = domain.getLaneID, self._lane_index
        ego_x, ego_y = self._ego_front
        boxes, poses, cos, sin = sight.boxes, sight.poses, math.cos, math.sin
        for name, row, half, length, width in bodies:
            x, y = position(name)
            dx, dy = x - ego_x, y - ego_y
            if dx * dx + dy * dy > ROAD_USER_RANGE_M * ROAD_USER_RANGE_M:
                continue
            heading = ((270.0 - angle(name)) % 360.0 - 180.0) * _RAD_PER_DEGREE
            x, y = x - half * cos(heading), y - half * sin(heading)
            sight.rows.append(row)
            boxes.append((x, y, heading, length, width))
            poses.append((x, y, heading))
            sight.speeds.append(speed(name))
            sight.lanes.append(lanes.get(lane_of(name), -1))
            sight.places.append(place(name))

    def close(self) -> None:
        """End SUMO in this process, unless another `Simulation` has a scene in it."""
        if _LIBRARY.holder is self:
            _LIBRARY.holder = None
            _LIBRARY.settle()
            libsumo.close()

    def _check_holder(self) -> None:
        if _LIBRARY.holder is not self:
            raise SimulationError(
                "no scene of this Simulation is loaded: SUMO holds one for the process, and another has taken its place"
            )
