"""The only module that talks to SUMO. One simulation per process; SUMO's angles and front positions end here.

Facts that this rests on were measured (spec/simulation.md, "Seen by measurement"): one context subscription around
the ego is the cheap way to read the world; a state is never saved and resumed; every float is checked before it
reaches `moveToXY`, which makes a vehicle with NaN vanish without a word.
"""

from __future__ import annotations

import math
from pathlib import Path

import libsumo
import numpy as np

from tsbench.errors import SimulationError
from tsbench.maps.network import RoadNetwork
from tsbench.sim.ego import Motion
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import DT_S, EGO_LENGTH_M, ActorKind, Actors, ActorTable

VIEW_M = 120.0
OBSTACLE_PREFIX = "obstacle"
CONVOY_PREFIX = "convoy"

_VARS = [
    libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_LANE_ID, libsumo.VAR_LANEPOSITION,
]  # fmt: skip
_SUMO_ERRORS = (libsumo.TraCIException, libsumo.FatalTraCIError, RuntimeError)
_POSITION, _ANGLE, _SPEED, _LANE, _LANE_POS = _VARS
_KINDS = {"bus": ActorKind.BUS, "coach": ActorKind.BUS, "bicycle": ActorKind.BICYCLE}
_OPTIONS = [
    "--step-length", str(DT_S), "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true",
    "--time-to-teleport", "-1", "--collision.action", "none", "--default.speeddev", "0", "--xml-validation", "never",
    "--xml-validation.net", "never", "--max-depart-delay", "5", "--ignore-route-errors", "false",
]  # fmt: skip


def sumo_version() -> str:
    """Version of the SUMO library, such as "SUMO 1.28.0"."""
    return str(libsumo.getVersion()[1])


class Simulation:
    """SUMO with one scene at a time. `load`, then `place_ego` and `step` in turn, then `actors`."""

    def __init__(self) -> None:
        self._running = False
        self._placed = False
        self._table = ActorTable()
        self._lane_index: dict[str, int] = {}

    def load(
        self, net: Path, additional: Path, network: RoadNetwork, seed: int, warn_to: Path | None = None
    ) -> None:
        """Load a scene's files. Raises SimulationError with SUMO's own words.

        warn_to: a file that takes SUMO's warnings (collisions, teleports) for certification.
        """
        options = ["-n", str(net), "-a", str(additional), "--seed", str(seed & 0x7FFFFFFF), *_OPTIONS]
        if warn_to is not None:
            options += ["--collision.action", "warn", "--no-warnings", "false", "--message-log", str(warn_to)]
        if self._placed:
            # A move that no step has carried out outlives its simulation and crashes the next one.
            self.step()
        try:
            if self._running:
                libsumo.load(options)
            else:
                libsumo.start(["sumo", *options])
                self._running = True
        except _SUMO_ERRORS as error:
            self._running = False
            raise SimulationError(f"{additional}: SUMO does not load the scene ({error})") from error
        self._lane_index = network.lane_index
        self._table = ActorTable()

    @property
    def table(self) -> ActorTable:
        """Road users seen since `load`."""
        return self._table

    def start_ego(self, motion: Motion, edge: str, lane_order: int) -> None:
        """First step: SUMO inserts what departs at time 0; then the ego is taken over and the view is set up."""
        self.step()
        if EGO_ID not in libsumo.vehicle.getIDList():
            raise SimulationError("SUMO did not insert the ego at its start")
        libsumo.vehicle.setSpeedMode(EGO_ID, 0)
        libsumo.vehicle.setLaneChangeMode(EGO_ID, 0)
        self.place_ego(motion, edge, lane_order)
        libsumo.vehicle.subscribeContext(EGO_ID, libsumo.CMD_GET_VEHICLE_VARIABLE, VIEW_M, _VARS)

    def place_ego(self, m: Motion, edge: str, lane_order: int) -> None:
        """Put the ego where its own motion says; `edge` and `lane_order` ("" and -1 where unknown) are only a hint."""
        half = EGO_LENGTH_M / 2
        x, y = m.x + half * math.cos(m.heading), m.y + half * math.sin(m.heading)
        if not math.isfinite(x + y + m.speed):
            raise SimulationError(f"the ego's pose is not finite ({m})")
        libsumo.vehicle.moveToXY(EGO_ID, edge, lane_order, x, y, 90.0 - math.degrees(m.heading), 2)
        libsumo.vehicle.setPreviousSpeed(EGO_ID, m.speed)
        self._placed = True

    def step(self) -> None:
        """Advance 0.1 s."""
        self._placed = False
        try:
            libsumo.simulationStep()
        except _SUMO_ERRORS as error:
            raise SimulationError(
                f"SUMO broke off at {libsumo.simulation.getTime():.1f} s ({error})"
            ) from error

    def set_route(self, edges: tuple[str, ...]) -> bool:
        """Tell SUMO where the ego is going, so that traffic sees it at junctions.

        Returns False, and changes nothing, while SUMO has the ego on another edge than the first one.
        """
        if libsumo.vehicle.getRoadID(EGO_ID) != edges[0]:
            return False
        libsumo.vehicle.setRoute(EGO_ID, edges)
        return True

    def hold(self, vehicle: str) -> None:
        """Keep a vehicle standing, and for good in the lane that its part in the scene asks for."""
        libsumo.vehicle.setLaneChangeMode(vehicle, 0)
        libsumo.vehicle.setSpeed(vehicle, 0.0)

    def release(self, vehicle: str) -> None:
        """Give a held vehicle back to its own driver."""
        libsumo.vehicle.setSpeed(vehicle, -1.0)

    def fleet(self) -> list[tuple[str, str, float, float]]:
        """All vehicles on the road, sorted by id: (id, lane id, front's place along it in m, speed in m/s)."""
        v = libsumo.vehicle
        return [(i, v.getLaneID(i), v.getLanePosition(i), v.getSpeed(i)) for i in sorted(v.getIDList())]

    def add_car(self, vehicle: str, vtype: str, edges: tuple[str, ...], lane_order: int) -> None:
        """Let a car of a loaded type in at the start of its first edge, as fast as is safe."""
        libsumo.route.add(f"{vehicle}_route", edges)
        libsumo.vehicle.add(
            vehicle,
            f"{vehicle}_route",
            vtype,
            departLane=str(lane_order),
            departPos="base",
            departSpeed="max",
        )

    def distance_driven(self, vehicle: str) -> float:
        """Metres since its departure, its start position included."""
        return float(libsumo.vehicle.getDistance(vehicle))

    def _enter(self, vehicle: str) -> int:
        v = libsumo.vehicle
        kind = _KINDS.get(v.getVehicleClass(vehicle), ActorKind.CAR)
        return self._table.add(
            vehicle, kind, v.getLength(vehicle), v.getWidth(vehicle), tuple(v.getRoute(vehicle))
        )

    def actors(self) -> Actors | None:
        """Road users within 120 m of the ego; None if the ego has left the map."""
        seen = libsumo.vehicle.getContextSubscriptionResults(EGO_ID)
        if EGO_ID not in seen:
            return None
        rows, lanes = self._table.rows, self._lane_index
        flat: list[tuple[float, float, float, float, float]] = []
        index: list[int] = []
        lane: list[int] = []
        for vehicle, value in seen.items():
            row = rows.get(vehicle, -1)
            if row < 0:
                if vehicle == EGO_ID or vehicle.startswith(OBSTACLE_PREFIX):
                    continue
                row = self._enter(vehicle)
            x, y = value[_POSITION]
            flat.append((x, y, value[_ANGLE], value[_SPEED], value[_LANE_POS]))
            index.append(row)
            lane.append(lanes.get(value[_LANE], -1))
        rows_i = np.array(index, dtype=np.int32)
        data = np.array(flat, dtype=np.float64).reshape(-1, 5)
        heading = ((270.0 - data[:, 2]) % 360.0 - 180.0) * (math.pi / 180.0)
        half = self._table.length[rows_i] * 0.5
        pose = np.empty((len(index), 3))
        pose[:, 0] = data[:, 0] - half * np.cos(heading)
        pose[:, 1] = data[:, 1] - half * np.sin(heading)
        pose[:, 2] = heading
        lane_i = np.array(lane, dtype=np.int32)
        # Planners get these very arrays: nobody may write into the record of what happened.
        for array in (rows_i, pose, data, lane_i):
            array.flags.writeable = False
        return Actors(self._table, rows_i, pose, data[:, 3], lane_i, data[:, 4])

    def close(self) -> None:
        """End SUMO in this process."""
        if self._running:
            libsumo.close()
            self._running = False


def scene_options(scene: Scene) -> list[str]:
    """Arguments that open a scene in sumo or sumo-gui as it is."""
    return ["-n", str(scene.net_path), "-a", str(scene.additional_path), "--step-length", str(DT_S)]
