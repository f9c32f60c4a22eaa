"""Others at a junction: they wait for an ego that waits, and do not show what the plates say before it is there."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from lxml import etree
from simworld import SceneMaker, loader_of, motion_at, plate

from tsbench.make.scenes.traffic import Car
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.convoy import SHOWS_AT_M, Approach, earliest_arrival
from tsbench.sim.junction_traffic import OLD_HOLD, JunctionTraffic, exchangeable
from tsbench.sim.scene import ConvoyPlan, EgoStart, Scene, SceneFile
from tsbench.sim.scene_file import late_entries, read_additional
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EgoState

START = EgoStart("s_in_0", 80.0, 0.0)
GIVE_WAY = {"approach": "s_in", "junction": "x", "main_in": "w_in e_in"}
LATE = (Car("bg_000", 0, 1.3, ("n_in", "s_out"), 0, None), Car("bg_001", 0, 4.3, ("e_in", "w_out"), 0, None))
CONVOY = ("w_in_0", (100.0, 88.0), ("w_in", "e_out"))


def scene(made: SceneMaker, name: str, code: str = "2.4", cars: tuple[Car, ...] = LATE) -> Scene:
    """The ego from the south, two cars on the main road, others who enter later."""
    sign = plate(made.network, "s_in", 140.0, code, **(GIVE_WAY if code == "2.4" else {}))
    plan = ConvoyPlan("s_in_0", 4.0, 60.0, 13.89, 5.0, ("convoy_0", "convoy_1"))
    spec: ScenarioSpec = made.make(
        name, START, Destination("n_out", 60.0), ("s_in", "n_out"), sign, cars=cars, convoy=plan, convoy_at=CONVOY
    )
    return loader_of(made.root).load(spec)[0]


class Stage:
    """The scene with an ego that stands wherever it is put."""

    def __init__(self, sim: Simulation, scene: Scene) -> None:
        self.sim, self.scene, self.network, self.ticks = sim, scene, scene.network, 0
        self.line_m = scene.network.lane("s_in_0").line.length
        self.traffic = JunctionTraffic(sim, scene)
        sim.start_ego(motion_at(self.network, START.lane, START.s), "s_in", 0)
        self.traffic.begin()
        sim.step()

    def stand(self, before_line: float, seconds: float, speed: float = 0.0) -> dict[str, tuple[str, float]]:
        """The ego's front is so far before its line for a while, as if it had that speed; where everybody is then."""
        s = self.line_m - before_line - EGO_LENGTH_M / 2
        m = motion_at(self.network, "s_in_0", s)
        ego = EgoState(m.x, m.y, m.heading, speed, 0.0, 0.0, 0.0, self.network.lane_index["s_in_0"], s, 0.0, True)
        for _ in range(round(seconds / DT_S)):
            self.traffic.update(ego)
            self.sim.place_ego(m, "s_in", 0)
            self.sim.step()
        return {name: (lane, place) for name, lane, place in self.sim.fleet()}


def test_everybody_waits_for_who_stands_far_from_its_line(sim: Simulation, on_cross: SceneMaker) -> None:
    stage = Stage(sim, scene(on_cross, "waits"))
    there = stage.stand(20.0, 40.0)
    lane, place = there["convoy_0"]
    assert lane == "w_in_0"
    assert place == pytest.approx(stage.network.lane("w_in_0").length - OLD_HOLD[0], abs=0.3)
    assert there["convoy_1"][0] == "w_in_0"
    assert there["convoy_1"][1] < place - 4.5
    assert not {"bg_000", "bg_001"} & set(there)
    assert stage.stand(SHOWS_AT_M + 0.2, 5.0).keys() == there.keys()
    # At its line all is let go: who is first enters at once, the next one as much later as it would have.
    there = stage.stand(SHOWS_AT_M - 0.2, 0.4)
    assert "bg_000" in there
    assert "bg_001" not in there
    assert "bg_001" not in stage.stand(SHOWS_AT_M - 0.2, 2.5)
    there = stage.stand(SHOWS_AT_M - 0.2, 0.6)
    assert "bg_001" in there
    assert there["convoy_0"][0] != "w_in_0"


def test_who_is_under_way_is_shown_nothing_before_it_is_too_late(sim: Simulation, on_cross: SceneMaker) -> None:
    """However slowly it comes: it could still stop where it would meet the convoy."""
    stage = Stage(sim, scene(on_cross, "slowly"))
    assert stage.scene.convoy is not None
    for speed in (1.5, 3.0, 5.0):
        assert "bg_000" not in stage.stand(speed**2 / 12.0, 3.0, speed)
    late = 12.0 - stage.scene.convoy.ego_zone_m
    assert "bg_000" not in stage.stand(late + 0.2, 0.5, 12.0)
    assert "bg_000" in stage.stand(late - 0.2, 0.5, 12.0)


def test_who_is_early_meets_them_by_their_own_time(sim: Simulation, on_cross: SceneMaker) -> None:
    stage = Stage(sim, scene(on_cross, "early"))
    # SUMO's clock is two steps ahead.
    there = stage.stand(SHOWS_AT_M - 0.2, 0.9)
    assert "bg_000" not in there
    assert "bg_000" in stage.stand(SHOWS_AT_M - 0.2, 0.5)
    assert "bg_001" not in stage.stand(SHOWS_AT_M - 0.2, 2.5)
    assert "bg_001" in stage.stand(SHOWS_AT_M - 0.2, 0.6)


def test_the_convoy_brakes_gently_for_its_hold(sim: Simulation, on_cross: SceneMaker) -> None:
    """Less than what the rule of giving way takes for forced."""
    stage, before, hardest = Stage(sim, scene(on_cross, "gently")), 0.0, 0.0
    for _ in range(400):
        stage.stand(20.0, DT_S)
        speed = sim.speeds("convoy_0")[0]
        hardest, before = max(hardest, (before - speed) / DT_S), speed
    assert before == 0.0
    assert 1.0 < hardest < 2.5


def led(stage: Stage, speed: float, seconds: float) -> list[float]:
    """The lead's place after each tick of an ego that comes at this speed from 90 m before its line."""
    there = [stage.stand(90.0 - speed * DT_S * k, DT_S, speed) for k in range(round(seconds / DT_S))]
    return [fleet["convoy_0"][1] for fleet in there]


def test_the_convoy_hurries_where_the_ego_could_be_through_before_it(sim: Simulation, on_cross: SceneMaker) -> None:
    """As long as plates are not shown."""
    calm, rushing = (led(Stage(sim, scene(on_cross, "rushes")), speed, 2.4) for speed in (10.0, 22.0))
    assert rushing[-1] > calm[-1] + 1.0


@pytest.mark.parametrize("speed", [3.0, 4.0, 5.0])
def test_a_slow_ego_meets_a_convoy_that_still_comes(sim: Simulation, on_cross: SceneMaker, speed: float) -> None:
    """It does not stand at its line when the ego decides, and brakes no harder than for its hold."""
    made = scene(on_cross, "slow")
    assert made.convoy is not None
    plan = replace(made.convoy, lead_time_s=9.0, ego_zone_m=4.0, ego_cruise_mps=11.1, after_s=2.5, keeps_back=True)
    made = replace(made, convoy=plan)
    stage, lead = Stage(sim, made), []
    to_line = 30.0
    while to_line + 4.0 > speed**2 / 12.0 + speed * DT_S:
        stage.stand(to_line, DT_S, speed)
        lead.append(sim.speeds("convoy_0")[0])
        to_line -= speed * DT_S
    assert lead[-1] > 3.0
    assert max(a - b for a, b in pairwise(lead)) < 2.5 * DT_S


def test_the_convoy_sets_off_where_it_could_otherwise_not_be_there(sim: Simulation, on_cross: SceneMaker) -> None:
    """Both do their utmost: 3 m/s2, up to 22.2 m/s."""
    made = scene(on_cross, "sooner")
    assert made.convoy is not None
    made = replace(made, convoy=replace(made.convoy, lead_time_s=5.0))
    moved, needed = {}, {}
    for speed in (0.5, 3.0, 6.0, 13.0, 22.0):
        stage = Stage(sim, made)
        before = stage.stand(60.0, DT_S, 0.0)["convoy_0"][1]
        moved[speed] = stage.stand(60.0, 3 * DT_S, speed)["convoy_0"][1] > before
        lead = earliest_arrival(stage.network.lane("w_in_0").length - before, 0.0, 3.0, 22.2)
        needed[speed] = lead + DT_S > earliest_arrival(60.0 + made.convoy.ego_zone_m, speed, 3.0, 22.2)
    assert moved == needed == {0.5: False, 3.0: False, 6.0: True, 13.0: True, 22.0: True}


def test_who_rushed_and_brakes_is_told_no_sooner(sim: Simulation, on_cross: SceneMaker) -> None:
    """A convoy that hurried stops before its line like any other."""
    stage = Stage(sim, scene(on_cross, "brakes"))
    led(stage, 22.0, 2.4)
    lane, place = stage.stand(20.0, 20.0)["convoy_0"]
    assert lane == "w_in_0"
    assert place == pytest.approx(stage.network.lane("w_in_0").length - OLD_HOLD[0], abs=0.3)


def entering(made: Scene) -> Scene:
    """The scene with a convoy that enters at the start of its arm, the second car 2 s after the first."""
    root = read_additional(made.additional.path, made.additional.content)
    for k, vehicle in enumerate(root.findall("vehicle[@type='convoy0']") + root.findall("vehicle[@type='convoy1']")):
        vehicle.attrib.update({"depart": str(9 + 2 * k), "departPos": "base", "departSpeed": "max"})
        del vehicle.attrib["insertionChecks"]
    return replace(made, additional=SceneFile(made.additional.path, etree.tostring(root)))


def test_a_convoy_enters_at_its_speed_when_it_is_released(sim: Simulation, on_cross: SceneMaker) -> None:
    made = entering(scene(on_cross, "enters"))
    assert made.convoy is not None
    # An ego that stands 130 m before its line cannot be in the zone before the convoy.
    stage = Stage(sim, replace(made, convoy=replace(made.convoy, lead_time_s=6.0)))
    assert "convoy_0" not in stage.stand(130.0, 20.0)
    there = stage.stand(20.0, 0.1)
    assert there["convoy_0"] == ("w_in_0", pytest.approx(4.5, abs=2.0))
    assert sim.speeds("convoy_0")[0] == pytest.approx(sim.pace("convoy_0")[0])
    assert "convoy_1" not in there
    assert "convoy_1" in stage.stand(20.0, 2.1)
    # It waits before its line, as one that stood there.
    there = stage.stand(20.0, 30.0)
    assert there["convoy_0"][0] == there["convoy_1"][0] == "w_in_0"
    end = stage.network.lane("w_in_0").length
    assert there["convoy_0"][1] == pytest.approx(end - OLD_HOLD[0], abs=0.3)


def test_where_plates_say_nothing_about_others_time_goes_on(sim: Simulation, on_cross: SceneMaker) -> None:
    made = scene(on_cross, "no-entry", "3.1")
    assert not exchangeable(made)
    there = Stage(sim, made).stand(20.0, 6.0)
    assert {"bg_000", "bg_001"} <= set(there)


def test_both_halves_of_a_pair_are_held(on_cross: SceneMaker) -> None:
    made = scene(on_cross, "halves")
    assert exchangeable(made)
    assert not exchangeable(replace(made, signs=(replace(made.target_signs[0], params=None),)))


def test_late_entries_are_taken_out_and_all_else_stays(on_cross: SceneMaker) -> None:
    made = scene(on_cross, "split")
    content, late = late_entries(made.additional)
    assert [(car.name, car.vtype, car.depart, car.edges, car.lane) for car in late] == [
        (car.id, "bg0", car.depart, car.edges, car.lane) for car in LATE
    ]
    assert b"bg_00" not in content
    assert content.count(b"<vehicle") == made.additional.content.count(b"<vehicle") - 2
    nobody = scene(on_cross, "nobody", cars=())
    assert late_entries(nobody.additional) == (nobody.additional.content, ())


def test_the_station_does_not_depend_on_the_lane(on_cross: SceneMaker) -> None:
    network = on_cross.network
    lane = network.lane("s_in_0")
    approach = Approach(lane)

    def at(s: float, d: float, index: int = -1) -> float:
        x, y = lane.line.point_at(0.0)
        here = EgoState(x - d, y + s, lane.line.heading_at(0.0), 5.0, 0.0, 0.0, 0.0, index, 0.0, 0.0, True)
        return approach.to_line(here)

    length, half = lane.line.length, EGO_LENGTH_M / 2
    for d in (0.0, 3.2, -3.0, 6.0):
        for s in (-10.0, 0.0, 30.0, length - 1.0, length, length + 20.0):
            assert at(s, d) == pytest.approx(length - s - half, abs=1e-6)
