"""SUMO's pedestrians on a crossing: held, let go, seen; how they and cars and an ego that is placed get on."""

from __future__ import annotations

import math
from dataclasses import replace

import libsumo
import pytest
from simworld import CALM, SceneMaker, motion_at, plate, road_plain

from tsbench.core.errors import SimulationError
from tsbench.make.placements.crosswalk import kerb_to_kerb, path_name, with_crossings
from tsbench.make.scenes.recipe import load_recipe
from tsbench.make.scenes.traffic import Car, walker_elements
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import load_catalog
from tsbench.sim.scene import EgoStart
from tsbench.sim.scene_file import read_additional
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import EGO_LENGTH_M, ActorKind, Actors

START = EgoStart("road.0_0", 20.0, 8.0)
SPEED = 1.25
WAY = (path_name("road", "right"), path_name("road", "left"))


@pytest.fixture(scope="module")
def on_crossing(tmp_path_factory: pytest.TempPathFactory) -> SceneMaker:
    """The straight road of two lanes, crossed at 100 m, and at 180 m where nobody walks."""
    folder = tmp_path_factory.mktemp("crossing")
    plain = road_plain(250.0, 2)
    road = replace(plain.edges[0], disallow="pedestrian")
    recipe = load_recipe("crosswalk", load_catalog())
    back = replace(road, id="back", source=road.target, target=road.source, num_lanes=1, shape=road.shape[::-1])
    plain = replace(plain, edges=(road, back))
    return SceneMaker.over(with_crossings(plain, road, back, (100.0, 180.0), recipe), folder)


@pytest.fixture(scope="module")
def spec(on_crossing: SceneMaker) -> ScenarioSpec:
    """One pedestrian 3 m from the right kerb, a car behind the ego's place on the other lane."""
    network = on_crossing.network
    path = network.edge_lanes(WAY[0])[0].line
    crossing = next(iter(network.crossings.values()))
    kerb = kerb_to_kerb(crossing, network.lane("road.0_0"), "right").points[0]
    at = math.dist(path.points[0], kerb) - 3.0
    extra = walker_elements("walker_0", (0.3, 0.5), SPEED, WAY, (at, 0.6), 8.0)
    return on_crossing.make(
        "walk", START, Destination("road.1", 100.0), ("road.0", "road.1"), plate(network, "road.0", 90.0, "5.19"),
        cars=[Car("bg_000", 0, 0.0, ("road.0", "road.1"), 1, 30.0)], change=lambda e: e.extend(extra),
    )  # fmt: skip


class Drive:
    """The loaded scene with the ego standing at a place along lane 0 unless told otherwise."""

    def __init__(self, sim: Simulation, made: SceneMaker, spec: ScenarioSpec, *, hold: bool = True) -> None:
        self.sim, self.network = sim, made.network
        lane = made.network.lane(START.lane)
        sim.load(made.net, made.path(spec), made.network, 7)
        self.motion = motion_at(made.network, START.lane, START.s)
        sim.start_ego(self.motion, lane.edge, lane.order)
        if hold:
            sim.hold_persons(("walker_0",))

    def step(self, x: float | None = None) -> Actors:
        if x is not None:
            self.motion = replace(self.motion, x=x)
        edge = "road.0" if self.motion.x + EGO_LENGTH_M / 2 < 97.0 else "road.1"
        self.sim.place_ego(self.motion, edge, 0)
        self.sim.step()
        actors = self.sim.actors()
        assert actors is not None
        return actors


def walker(actors: Actors) -> tuple[float, float, float, float]:
    """x, y, heading and speed of the pedestrian."""
    at = actors.index.tolist().index(actors.table.rows["walker_0"])
    x, y, heading = actors.pose[at].tolist()
    return x, y, heading, float(actors.speed[at])


@pytest.fixture
def drive(sim: Simulation, on_crossing: SceneMaker, spec: ScenarioSpec) -> Drive:
    return Drive(sim, on_crossing, spec)


def test_a_crossing_is_read_with_its_kerbs(on_crossing: SceneMaker) -> None:
    crossing = next(c for c in on_crossing.network.crossings.values() if "road.0" in c.edges)
    assert crossing.width == 4.0
    assert crossing.line.length == pytest.approx(9.6, abs=0.05)
    assert sorted(crossing.line.points[:, 1]) == pytest.approx([-6.4, 3.2], abs=0.05)
    assert crossing.line.points[:, 0] == pytest.approx([100.0, 100.0], abs=0.05)
    assert sorted(crossing.edges) == ["back.2", "road.0"]


def test_who_is_held_stands_and_then_walks_straight_over(drive: Drive) -> None:
    places = [walker(drive.step()) for _ in range(120)]
    assert len({p[:2] for p in places}) == 1
    assert places[0][3] == 0.0
    # 3 m from the kerb, with the front.
    assert places[0][1] == pytest.approx(-6.4 - 3.0 - 0.15, abs=0.05)
    drive.sim.let_walk("walker_0", SPEED)
    walked = [walker(drive.step()) for _ in range(80)]
    assert walked[79][1] - walked[9][1] == pytest.approx(7.0 * SPEED, abs=0.15)
    assert all(math.sin(h) == pytest.approx(1.0, abs=0.1) for _, _, h, _ in walked[30:])
    assert all(98.0 <= x <= 102.0 for x, *_ in walked)
    assert {s for *_, s in walked[2:]} == {SPEED}


def test_is_seen_as_a_pedestrian_behind_the_vehicles(drive: Drive) -> None:
    actors = drive.step()
    assert [actors.table.ids[i] for i in actors.index] == ["bg_000", "walker_0"]
    assert actors.kind.tolist() == [ActorKind.CAR, ActorKind.PEDESTRIAN]
    assert (actors.length[1], actors.width[1]) == pytest.approx((0.3, 0.5))
    assert actors.table.routes[1] == ()
    footpath = drive.network.lane_index[f"{WAY[0]}_0"]
    assert actors.lane[1] == footpath
    drive.sim.let_walk("walker_0", SPEED)
    lanes = [int(drive.step().lane[-1]) for _ in range(60)]
    assert lanes[0] == footpath
    assert lanes[-1] == -1
    assert len(actors.boxes) == len(actors) == 2


def test_is_gone_at_the_end_of_the_way(drive: Drive) -> None:
    drive.sim.let_walk("walker_0", SPEED)
    seen = [len(drive.step()) for _ in range(400)]
    assert seen[0] == 2
    assert "walker_0" not in [drive.step().table.ids[i] for i in drive.step().index]
    drive.sim.let_walk("walker_0", SPEED)


def test_steps_onto_the_road_before_an_ego_that_comes(drive: Drive) -> None:
    drive.sim.let_walk("walker_0", SPEED)
    # At 10 m/s, 18 m before the crossing when the pedestrian is at the kerb.
    seen = [walker(drive.step(52.0 + k)) for k in range(40)]
    on_road = next(k for k, p in enumerate(seen) if p[1] > -6.4)
    assert on_road * 0.1 == pytest.approx(3.15 / SPEED, abs=0.25)
    assert {p[3] for p in seen[2 : on_road + 8]} == {SPEED}


def test_waits_at_the_kerb_while_the_ego_stands_on_the_crossing(drive: Drive) -> None:
    for _ in range(5):
        drive.step(100.0)
    drive.sim.let_walk("walker_0", SPEED)
    for _ in range(100):
        y = walker(drive.step())[1]
    assert -8.0 <= y <= -6.2
    for _ in range(60):
        y = walker(drive.step(130.0))[1]
    assert y > -2.0


def test_cars_let_people_cross(drive: Drive) -> None:
    fronts = []
    drive.sim.let_walk("walker_0", SPEED)
    for _ in range(130):
        actors = drive.step()
        fronts.append((float(actors.pose[0, 0]) + CALM.length / 2, walker(actors)[1]))
    crossing = [x for x, y in fronts if -6.4 <= y <= -0.2]
    assert len(crossing) > 30
    assert all(x < 98.5 for x in crossing)
    assert fronts[-1][0] > 104.0


def test_the_plain_scene_lets_them_walk_at_their_nominal_time(
    sim: Simulation, on_crossing: SceneMaker, spec: ScenarioSpec
) -> None:
    Drive(sim, on_crossing, spec, hold=False)
    speeds = []
    for _ in range(120):
        sim.step()
        speeds.append(libsumo.person.getSpeed("walker_0"))
    assert max(speeds[:75]) == 0.0
    assert speeds[90] == pytest.approx(SPEED)


def test_the_same_scene_gives_the_same_bytes(sim: Simulation, on_crossing: SceneMaker, spec: ScenarioSpec) -> None:
    def bytes_of() -> list[bytes]:
        drive = Drive(sim, on_crossing, spec)
        drive.step()
        drive.sim.let_walk("walker_0", SPEED)
        return [a.pose.tobytes() + a.speed.tobytes() for a in (drive.step(40.0 + k) for k in range(100))]

    assert bytes_of() == bytes_of()


def test_scenes_without_people_ask_for_none_and_missing_ones_are_an_error(
    sim: Simulation, on_crossing: SceneMaker, spec: ScenarioSpec
) -> None:
    drive = Drive(sim, on_crossing, spec, hold=False)
    assert [drive.step().table.ids[i] for i in drive.step().index] == ["bg_000"]
    with pytest.raises(SimulationError, match="did not insert pedestrian walker_9"):
        sim.hold_persons(("walker_9",))


def test_additional_file_is_one_that_sumo_gui_opens(on_crossing: SceneMaker, spec: ScenarioSpec) -> None:
    (person,) = read_additional(on_crossing.path(spec)).iterfind("person")
    assert [e.tag for e in person] == ["stop", "walk"]
    assert (person.get("depart"), person[0].get("duration")) == ("0", "8")
