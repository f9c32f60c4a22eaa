"""`tsbench.drive`: the episode that a run drives, step by step, with the planner in this process."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tsbench
from tsbench.core.errors import InputError

SCENARIO = min(one.scenario_id for one in tsbench.load_scenarios("dev", "yield"))


def straight(_: tsbench.Observation) -> tsbench.Control:
    return tsbench.Control(0.0, 0.0)


class Breaks:
    floor = False

    def reset(self, context: tsbench.PlannerContext) -> None:
        self.left = 2

    def act(self, observation: tsbench.Observation) -> tsbench.Control:
        self.left -= 1
        if self.left < 0:
            raise ZeroDivisionError("mine")
        return tsbench.Control(0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planner", "options"),
    [("idm-e", {}), ("blind", {}), ("coin", {}), ("reader", {"perception": "poor"}), ("reader", {"mask_signs": True})],
)
def test_it_drives_what_a_run_drives(tmp_path: Path, planner: str, options: dict[str, object]) -> None:
    run = tsbench.evaluate(planner, split="dev", types="yield", limit=2, workers=1, out=tmp_path / "run", **options)  # type: ignore[arg-type]
    for row in run.episodes.to_dict("records"):
        done = tsbench.drive(planner, row["scenario_id"], **options).run()  # type: ignore[arg-type]
        assert done.record["scenario_id"] == row["scenario_id"]
        differing = {k for k, v in done.record.items() if v is not None and v == v and v != row[k]}
        assert not differing
        told = run.violations[(run.violations.scenario_id == row["scenario_id"]) & run.violations.target]
        assert sorted(done.violations) == sorted(told.clause)


def test_step_by_step() -> None:
    drive = tsbench.drive(straight, SCENARIO)
    assert (drive.time, drive.answer, drive.outcome, drive.record) == (0.0, None, None, None)
    assert drive.observation.step == 0
    assert drive.step()
    assert drive.answer == tsbench.Control(0.0, 0.0)
    assert drive.run(until=1.0).observation is not None
    assert (drive.time, drive.observation.step) == (pytest.approx(1.0), 10)
    told = drive.look()
    assert told.startswith("t 1.0 s: ego ")
    assert "plate 2.4: " in told
    assert "answered: acceleration 0.000 m/s2, steering 0.0000 rad" in told
    assert told.endswith("No violation.")
    # One's own answer in place of the planner's.
    before = drive.observation.ego.speed
    drive.step(tsbench.Control(-3.0, 0.0))
    assert drive.observation.ego.speed < before
    pytest.importorskip("cv2")
    assert drive.frame.startswith(b"\x89PNG")
    drive.run()
    assert drive.outcome is not None
    assert drive.look().startswith(f"Episode ended: {drive.outcome} (")
    assert not drive.step()


def halting(o: tsbench.Observation) -> tsbench.Control:
    return tsbench.Control(-6.0 if o.time >= 2.0 else 0.0, 0.0)


def test_the_end_says_since_when_the_ego_stands_and_before_what() -> None:
    first, sign, other, stands, now, *around = tsbench.drive(halting, SCENARIO).run().look().splitlines()
    assert first == "Episode ended: timeout (failed). No violation."
    assert sign == "The sign is 2.4 Give way."
    assert other.startswith("With the other half's plates, 2.1 Main road, the same drive has: At ")
    halted = re.fullmatch(
        r"The ego stands since (.*) s, (.*) m before the line of 2.4; nothing is on its path.", stands
    )
    assert 2.0 < float(halted[1]) < 6.0
    assert 0.0 < float(halted[2]) < 60.0
    assert ": ego 0.00 m/s at " in now
    assert now.endswith(" m to the destination")
    assert any(line.startswith("plate 2.4: ") and " m ahead, " in line for line in around)
    passed = tsbench.drive("idm-e", SCENARIO).run().look()
    assert passed.startswith("Episode ended: arrived (passed). No violation.\nThe sign is 2.4 Give way.\nWith")


def test_the_end_says_how_far_the_path_is_free() -> None:
    detour = min(one.scenario_id for one in tsbench.load_scenarios("dev", "detour_left"))
    told = tsbench.drive(halting, detour).run().look()
    found = re.search(r"m before the line of 4.2.2; its path is free for (.*) m\.", told)
    assert 0.0 < float(found[1]) < 100.0


def test_the_end_has_the_sentences_of_what_is_held_against_it() -> None:
    drive = tsbench.drive("idm", SCENARIO).run()
    first, _, *sentences, other = drive.look().splitlines()
    assert first == f"Episode ended: {drive.outcome} (failed). Against it: {', '.join(drive.violations)}."
    assert len(sentences) == len(drive.violations) > 0
    assert all("the ego" in sentence for sentence in sentences)
    assert other == "With the other half's plates, 2.1 Main road, the same drive has: no violation."


def test_halves_of_one_sign_are_told_by_what_is_around_it() -> None:
    main_road = min(one.scenario_id for one in tsbench.load_scenarios("dev", "main_road"))
    told = tsbench.drive("idm", main_road).run().look().splitlines()
    assert "The sign is 2.1 Main road." in told
    assert told[-1].startswith("With the other half's plates, the same sign with others around it, the same drive has:")


def test_the_mean_speed_that_is_judged_has_its_stretch() -> None:
    def slow(o: tsbench.Observation) -> tsbench.Control:
        return tsbench.Control(0.5 * (5.0 - o.ego.speed), 0.0)

    contrast = max(one.scenario_id for one in tsbench.load_scenarios("dev", "speed_limit"))
    lines = tsbench.drive(slow, contrast).run().look().splitlines()
    means = [line for line in lines if line.startswith("The mean is that of the ")]
    assert "The mean is that of the drive from its start to where the zone begins." in means
    assert any(line.endswith(" m of the zone.") for line in means)


def test_what_a_planner_raises_is_raised_where_it_happens() -> None:
    drive = tsbench.drive(Breaks(), SCENARIO)
    with pytest.raises(ZeroDivisionError, match="mine"):
        drive.run()
    # The tick is still there to be looked at, and driven otherwise.
    assert drive.observation.step == 2
    assert drive.step(tsbench.Control(0.0, 0.0))


def test_what_is_no_answer_is_the_outcome_of_a_run() -> None:
    drive = tsbench.drive(lambda _: "left", SCENARIO).run()  # type: ignore[arg-type,return-value]
    assert drive.outcome == "invalid_output"
    assert "expected Control or Trajectory" in drive.look()


def test_a_scene_of_another_city_is_drawn_in_it() -> None:
    pytest.importorskip("cv2")
    row = tsbench.load_scenarios("dev", "yield", city="north-bayreuth")[0]
    drive = tsbench.drive(straight, row.scenario_id, city="north-bayreuth")
    assert drive.step()
    assert drive.frame.startswith(b"\x89PNG")


def test_one_at_a_time() -> None:
    first = tsbench.drive(straight, SCENARIO)
    tsbench.drive(straight, SCENARIO)
    with pytest.raises(InputError, match="another episode has begun since"):
        first.step()


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(
        InputError, match=r"^nowhere: no scenario of any split that is here; tsbench scenarios list names them$"
    ):
        tsbench.drive(straight, "nowhere")
    with pytest.raises(InputError, match=f"^{SCENARIO}: no scenario of test"):
        tsbench.drive(straight, SCENARIO, split="test")
    with pytest.raises(InputError, match="an object with reset and act"):
        tsbench.drive(3, SCENARIO)  # type: ignore[arg-type]
