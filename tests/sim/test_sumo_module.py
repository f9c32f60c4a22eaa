"""The one module that talks to SUMO, on small scenes. All in this process, in which SUMO has one scene."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
import simworld
from command_line import one_line
from patience import HANG_S
from simworld import CALM, SceneMaker, motion_at, obstacle, plate

from tsbench.core.errors import SimulationError
from tsbench.make.scenes.traffic import Car
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import Motion, advance
from tsbench.sim.scene import EgoStart
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import EGO_LENGTH_M, ActorKind, Actors, ActorTable

START = EgoStart("w_in_0", 40.0, 8.0)
END = Destination("e_out", 60.0)
WAY = ("w_in", "e_out")
CARS = [
    Car("bg_000", 0, 0.0, ("w_in", "e_out"), 0, 100.0),
    Car("bg_001", 0, 0.0, ("e_in", "w_out"), 0, 60.0),
    Car("bg_002", 0, 0.0, ("s_in", "n_out"), 0, 100.0),
    Car("bg_003", 0, 1.3, ("n_in", "s_out"), 0, None),
]


def scene(on_cross: SceneMaker, name: str, cars: list[Car], start: EgoStart = START, **more: object) -> ScenarioSpec:
    sign = plate(on_cross.network, "w_in", 139.0)
    return on_cross.make(name, start, END, WAY, sign, cars=cars, **more)  # type: ignore[arg-type]


def begin(sim: Simulation, made: SceneMaker, spec: ScenarioSpec, start: EgoStart = START, seed: int = 7) -> Motion:
    """Load as an episode does."""
    network = made.network
    lane = network.lane(start.lane)
    motion = motion_at(network, start.lane, start.s, start.speed)
    sim.load(made.net, made.path(spec), network, seed)
    sim.start_ego(motion, lane.edge, lane.order)
    sim.step()
    return motion


def stand(sim: Simulation, m: Motion, edge: str, ticks: int) -> list[Actors]:
    """The ego does not move; what SUMO does around it."""
    seen = []
    for _ in range(ticks):
        sim.place_ego(m, edge, 0)
        sim.step()
        now = sim.actors()
        assert now is not None
        seen.append(now)
    return seen


@pytest.fixture(scope="module")
def busy(on_cross: SceneMaker) -> ScenarioSpec:
    return scene(on_cross, "busy", CARS)


def sumo_front() -> tuple[float, float]:
    x, y = libsumo.vehicle.getPosition("ego")
    return float(x), float(y)


def test_the_ego_is_where_its_geometry_says(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    m = begin(sim, on_cross, busy)
    commands = [(-1.0, 0.3), (2.0, -0.4), (0.0, 0.1), (-3.0, 0.5), (3.0, -0.2)]
    for k in range(50):
        half = EGO_LENGTH_M / 2
        front = (m.x + half * math.cos(m.heading), m.y + half * math.sin(m.heading))
        assert sumo_front() == pytest.approx(front, abs=0.01)
        angle = math.radians(90.0 - libsumo.vehicle.getAngle("ego"))
        assert math.cos(angle - m.heading) == pytest.approx(1.0, abs=1e-6)
        m = advance(m, *commands[k % 5])
        # Every third tick without the hint: SUMO has to find the place by itself.
        sim.place_ego(m, "w_in" if k % 3 else "", 0 if k % 3 else -1)
        sim.step()


def test_actors_are_centres_on_their_lanes(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    m, network = begin(sim, on_cross, busy), on_cross.network
    seen = stand(sim, m, "w_in", 30)
    # A car behind the ego of 40 m or the one that starts 100 m along: the one ahead is within view.
    assert set(seen[0].table.ids) >= {"bg_000", "bg_002"}
    for a in seen:
        assert len(a) == len(a.pose) == len(a.speed) == len(a.lane) == len(a.lane_s)
        assert "ego" not in [a.table.ids[i] for i in a.index]
        for k in range(len(a)):
            lane = network.lanes[int(a.lane[k])]
            s, d = lane.line.project(float(a.pose[k, 0]), float(a.pose[k, 1]))
            assert abs(d) < 0.6 if lane.internal else abs(d) < 0.05
            behind = float(a.lane_s[k]) - s
            if not lane.internal and float(a.lane_s[k]) > 6.0:
                assert behind == pytest.approx(CALM.length / 2, abs=0.02)
        assert a.kind.tolist() == [ActorKind.CAR] * len(a)
        assert a.length.tolist() == [CALM.length] * len(a)
        assert a.width.tolist() == [CALM.width] * len(a)
    first = seen[0]
    row = first.index.tolist().index(first.table.rows["bg_000"])
    assert math.cos(first.pose[row, 2]) == pytest.approx(1.0)
    assert first.table.routes[first.table.rows["bg_000"]] == ("w_in", "e_out")
    # What came along as plain numbers is what the arrays say.
    assert all(replace(now, known_boxes=None).boxes == now.known_boxes for now in seen)


def test_nobody_can_write_into_the_record(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    begin(sim, on_cross, busy)
    a = sim.actors()
    assert a is not None
    assert len(a) > 0
    for array in (a.pose, a.speed, a.index, a.lane, a.lane_s):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def stream(sim: Simulation, made: SceneMaker, spec: ScenarioSpec) -> str:
    """Digest of everything that is seen in ten seconds."""
    m = begin(sim, made, spec)
    digest = hashlib.sha256()
    for k in range(100):
        m = advance(m, 0.5 if k < 40 else -1.5, 0.02 if k % 20 < 10 else -0.02)
        sim.place_ego(m, "", -1)
        sim.step()
        a = sim.actors()
        for array in (a.index, a.pose, a.speed, a.lane, a.lane_s):
            digest.update(array.tobytes())
        digest.update(repr(a.table.ids).encode())
    return digest.hexdigest()


FOLDERS = [str(Path(file).parent) for file in (__file__, str(simworld.__file__))]
CHILD = """
import sys
sys.path[:0] = sys.argv[1].split(":")
from pathlib import Path
from simworld import SceneMaker, simulation
from test_sumo_module import stream
from tsbench.roads.network import read_network
from tsbench.scenarios.spec import ScenarioSpec
net = Path(sys.argv[2])
spec = eval(sys.argv[3], {"ScenarioSpec": ScenarioSpec})
print(stream(simulation(), SceneMaker(net.parent, net, read_network(net)), spec))
"""


def test_the_same_scene_is_the_same_to_the_byte(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    first = stream(sim, on_cross, busy)
    other = scene(on_cross, "other", CARS[:2])
    between = stream(sim, on_cross, other)
    again = stream(sim, on_cross, busy)
    child = subprocess.run(
        [sys.executable, "-c", CHILD, os.pathsep.join(FOLDERS), str(on_cross.net), repr(busy)],
        capture_output=True, text=True, check=True, timeout=HANG_S,
        env={"PYTHONHASHSEED": "77", "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    assert first == again == child.stdout.split()[-1]
    assert first != between


def test_a_follower_brakes_for_an_ego_that_stands(sim: Simulation, on_cross: SceneMaker) -> None:
    start = EgoStart("w_in_0", 100.0, 0.0)
    follower = [Car("bg_000", 0, 0.0, WAY, 0, 40.0)]
    spec = scene(on_cross, "follower", follower, start)
    m = begin(sim, on_cross, spec, start)
    seen = stand(sim, m, "w_in", 200)
    speed = [float(a.speed[0]) for a in seen]
    gap = [m.x - EGO_LENGTH_M / 2 - (float(a.pose[0, 0]) + CALM.length / 2) for a in seen]
    assert max(speed) > 6.0
    assert speed[-1] < 0.1
    assert 0.5 < gap[-1] < 4.0
    assert min(gap) > 0.5
    assert np.diff(speed).min() > -0.6  # not harder than 6 m/s2


def test_side_traffic_gives_way_to_an_ego_on_the_main_road(sim: Simulation, on_cross: SceneMaker) -> None:
    start = EgoStart("w_in_0", 70.0, 7.5)
    side = [Car("bg_000", 0, 0.0, ("s_in", "n_out"), 0, 80.0)]
    spec = scene(on_cross, "side", side, start)

    def crossing_time(place_ego: bool) -> tuple[float, float]:
        """When the side road's car is in the junction, and how near it comes to the ego."""
        m = begin(sim, on_cross, spec, start)
        if not place_ego:
            libsumo.vehicle.remove("ego")
        nearest, entered = math.inf, math.inf
        for k in range(250):
            if place_ego:
                m = advance(m, 0.0, 0.0)
                edge = "w_in" if m.x < -7 else "e_out" if m.x > 7 else ""
                sim.place_ego(m, edge, 0 if edge else -1)
            sim.step()
            if "bg_000" in libsumo.vehicle.getIDList():
                x, y = libsumo.vehicle.getPosition("bg_000")
                if y > -1.6 - 1.0:
                    entered = min(entered, k * 0.1)
                nearest = min(nearest, math.hypot(x - m.x, y - m.y)) if place_ego else nearest
            if m.x > 130:
                break
        return entered, nearest

    alone, _ = crossing_time(False)
    waits, nearest = crossing_time(True)
    assert alone < 12.0
    assert waits > alone + 0.5
    assert nearest > 3.0


def test_an_obstacle_stops_traffic_and_is_no_road_user(sim: Simulation, on_cross: SceneMaker) -> None:
    cones = obstacle(on_cross.network, "w_in_0", 110.0)
    spec = scene(on_cross, "cones", [Car("bg_000", 0, 0.0, WAY, 0, 60.0)], obstacles=[cones])
    m = begin(sim, on_cross, spec)
    last = stand(sim, m, "w_in", 150)[-1]
    assert [last.table.ids[i] for i in last.index] == ["bg_000"]
    assert float(last.speed[0]) < 0.1
    assert float(last.pose[0, 0]) + CALM.length / 2 < cones.x - cones.length / 2
    assert ("obstacle_0", "w_in_0") in [f[:2] for f in sim.fleet()]


def test_a_held_vehicle_waits_and_a_released_one_drives(sim: Simulation, on_cross: SceneMaker) -> None:
    near = EgoStart("w_in_0", 100.0, 0.0)
    spec = scene(on_cross, "convoy", [], near, convoy_at=("e_in_0", (110.0, 100.0), ("e_in", "w_out")))
    m = begin(sim, on_cross, spec, near)
    for name in ("convoy_0", "convoy_1"):
        sim.hold(name)
    held = stand(sim, m, "w_in", 50)
    assert len(held[0]) == 2
    assert held[0].pose[:, 0] == pytest.approx(held[-1].pose[:, 0], abs=0.05)
    began = sim.distance_driven("convoy_0")
    for name in ("convoy_0", "convoy_1"):
        sim.release(name)
    gone = stand(sim, m, "w_in", 50)
    assert float(gone[-1].speed.min()) > 3.0
    assert sim.distance_driven("convoy_0") > began + 10.0


def test_an_ego_that_sumo_has_taken_out_has_left_the_map(sim: Simulation, on_cross: SceneMaker) -> None:
    begin(sim, on_cross, scene(on_cross, "gone", CARS))
    assert sim.actors() is not None
    libsumo.vehicle.remove("ego")
    sim.step()
    assert sim.actors() is None


def test_set_route_only_from_the_edge_that_the_ego_is_on(sim: Simulation, on_cross: SceneMaker) -> None:
    m = begin(sim, on_cross, scene(on_cross, "route", []))
    assert not sim.set_route(("s_in", "n_out"))
    assert sim.set_route(("w_in", "n_out"))
    assert libsumo.vehicle.getRoute("ego") == ("w_in", "n_out")
    stand(sim, m, "w_in", 3)


REFUSED = {
    "an edge that is not there": ([Car("bg_000", 0, 0.0, ("zz", "e_out"), 0, 10.0)], START, "does not load"),
    "a type that is not there": ([Car("bg_000", 9, 0.0, WAY, 0, 10.0)], START, "does not load"),
    "edges that do not connect": ([Car("bg_000", 0, 0.0, ("w_in", "e_in"), 0, 10.0)], START, "no valid route"),
    "a lane that is not there": ([Car("bg_000", 0, 0.0, WAY, 4, 10.0)], START, "departLane"),
    "a start above the limit": ([], EgoStart("w_in_0", 40.0, 20.0), "too high for the departure edge"),
}


@pytest.mark.parametrize("what", sorted(REFUSED))
def test_what_sumo_refuses_is_an_error_and_the_next_scene_loads(
    sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec, what: str
) -> None:
    cars, start, words = REFUSED[what]
    spec = scene(on_cross, f"refused-{len(what)}", cars, start)
    with one_line(words, kind=SimulationError):
        begin(sim, on_cross, spec, start)
    begin(sim, on_cross, busy)
    now = sim.actors()
    assert now is not None
    assert len(now) >= 2


def test_a_truncated_additional_file(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    spec = scene(on_cross, "cut", CARS)
    path = on_cross.path(spec)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(SimulationError):
        begin(sim, on_cross, spec)
    begin(sim, on_cross, busy)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_no_pose_that_is_no_number_reaches_sumo(
    sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec, bad: float
) -> None:
    m = begin(sim, on_cross, busy)
    for wrong in (Motion(bad, 0, 0, 1), Motion(0, bad, 0, 1), Motion(m.x, m.y, 0, bad)):
        with pytest.raises(SimulationError, match="not finite"):
            sim.place_ego(wrong, "w_in", 0)
    assert sumo_front()[0] == pytest.approx(m.x + EGO_LENGTH_M / 2, abs=0.01)


def test_a_move_that_no_step_carried_out_does_not_hurt_the_next_load(
    sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec
) -> None:
    for _ in range(3):
        m = begin(sim, on_cross, busy)
        sim.place_ego(m, "w_in", 0)
    begin(sim, on_cross, busy)
    assert sim.actors() is not None


def test_the_table_starts_anew_with_each_scene(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    m = begin(sim, on_cross, busy)
    stand(sim, m, "w_in", 5)
    kept = sim.table
    assert kept.ids
    names = list(kept.ids)
    begin(sim, on_cross, scene(on_cross, "empty", []))
    assert sim.table is not kept
    assert sim.table.ids == []
    assert kept.ids == names  # the record of the episode before stays as it was


def test_a_simulation_can_be_closed_and_opened_again(sim: Simulation, on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    begin(sim, on_cross, busy)
    sim.close()
    sim.close()
    begin(sim, on_cross, busy)
    assert sim.actors() is not None


def test_a_second_simulation_takes_over_and_the_first_is_told(on_cross: SceneMaker, busy: ScenarioSpec) -> None:
    first, second = Simulation(), Simulation()
    motion = begin(first, on_cross, busy)
    alone = stand(first, motion, "w_in", 20)[-1]
    # A move that no step has carried out, and its simulation is given up.
    first.place_ego(motion, "w_in", 0)
    motion = begin(second, on_cross, busy)
    for forbidden in (first.step, lambda: first.place_ego(motion, "w_in", 0)):
        with pytest.raises(SimulationError, match="another has taken its place"):
            forbidden()
    first.close()
    assert stand(second, motion, "w_in", 20)[-1].pose.tobytes() == alone.pose.tobytes()
    assert stand(first, begin(first, on_cross, busy), "w_in", 20)[-1].pose.tobytes() == alone.pose.tobytes()
    first.place_ego(motion, "w_in", 0)
    first.close()
    assert stand(second, begin(second, on_cross, busy), "w_in", 20)[-1].pose.tobytes() == alone.pose.tobytes()
    second.close()


def test_table_grows_without_losing_anyone() -> None:
    table = ActorTable(2)
    rows = [table.add(f"v{k}", ActorKind.BUS, 10.0 + k, 2.0, ("a", "b")) for k in range(9)]
    assert rows == list(range(9))
    assert table.length[:9].tolist() == [10.0 + k for k in range(9)]
    assert table.kind[:9].tolist() == [1] * 9
    assert table.rows["v7"] == 7
