"""Frames of obedient drives: what plant2-ft sees in use, signs included, and only of drives that succeeded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from learned_scenes import recorded_drive
from training_helpers import fresh_tuned, fresh_weights

from tsbench.episode.observer import destination_on_map
from tsbench.episode.outcome import Outcome
from tsbench.episode.perception_level import EXACTLY, Perception, load_level
from tsbench.learn.imitation.frames import DriveResult, Drivers, PlannerDrive, observations
from tsbench.learn.imitation.frames_store import plan_hash
from tsbench.learn.imitation.targets import FinetuneSampling, FinetuneSource, RecordedDrive, TakeoverDrive
from tsbench.learn.oracle.trajectories import fingerprints
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_planner import Plant2Ft
from tsbench.learn.plant2.sign_tokens import vocabulary_of
from tsbench.metrics.scd import is_scd
from tsbench.planners.base import PlannerContext
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import CONTRAST, HALVES, ScenarioSpec
from tsbench.sim.world import DT_S

pytestmark = pytest.mark.slow

WORDS = vocabulary_of()
SOURCE = FinetuneSource(FinetuneSampling(), WORDS)


@pytest.fixture(scope="module")
def row() -> ScenarioSpec:
    return next(r for r in DataSet().table("test") if r.scenario_type == "stop" and r.variant == 0)


@pytest.fixture(scope="module")
def drivers() -> Iterator[Drivers]:
    made = Drivers()
    yield made
    made.close()


@pytest.fixture(scope="module")
def student(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fresh_weights(tmp_path_factory.mktemp("student"), "plant2-ft", fresh_tuned)


def held(frames: at.Records) -> list[tuple[str, float]]:
    """The code that holds on the way, and whether the ego has stood for it."""
    codes = [WORDS.codes[k - 1] if k else "" for k in frames["held_classes"][:, 0].tolist()]
    return list(zip(codes, frames["held"][:, 0, -1].tolist(), strict=True))


def test_a_recorded_drive_shows_what_the_planner_sees_in_use(row: ScenarioSpec, drivers: Drivers) -> None:
    _, recorded = drivers.kept("recording", partial(recorded_drive, "idm-e", row))
    drive = RecordedDrive(row, recorded)
    driven = drive.run(drivers)
    assert is_scd(driven.facts)
    frames = SOURCE.frames(driven, drivers, np.random.default_rng(0))
    own = frames[::2]

    planner = Plant2Ft(lambda records: np.zeros(len(records), dtype=at.PLAN))
    view = driven.roads.view
    goal = destination_on_map(view, driven.facts.scene)
    planner.reset(PlannerContext(0, view.map, view.graph, goal, DT_S))
    shown = {}
    for o in observations(driven.facts, driven.roads):
        planner.act(o)
        shown[planner.encode(o)[0].tobytes()] = o.step
    fields = list(at.SIGN_TOKENS.names or ())
    seen = np.zeros(len(own), dtype=at.SIGN_TOKENS)
    for name in fields:
        seen[name] = own[name]
    steps = [shown[frame.tobytes()] for frame in seen]
    assert steps == sorted(steps)

    # Once the ego has stood, that is remembered beside the plate.
    states = held(own)
    turn = states.index(("2.5", 1.0))
    assert set(states[:turn]) == {("2.5", 0.0)}
    assert set(states[turn:]) == {("2.5", 1.0)}
    assert own["speed"][turn - 1] < 0.4
    assert own["decides"].mean() > 0.5
    assert np.array_equal(own["speed"], frames["speed"][1::2])


def test_a_drive_that_disobeyed_teaches_nothing(row: ScenarioSpec, drivers: Drivers) -> None:
    driven = PlannerDrive(row, "idm").run(drivers)
    assert not is_scd(driven.facts)
    assert len(SOURCE.frames(driven, drivers, np.random.default_rng(0))) == 0


def half(drivers: Drivers, kind: str, name: str, planner: str) -> DriveResult:
    """A planner's drive of one half of a pair of this type."""
    rows = DataSet().table("test")
    row = next(r for r in rows if r.pair_type == kind and r.half == name and r.variant == 0)
    return PlannerDrive(row, planner).run(drivers)


def test_masked_frames_show_posts_and_are_answered_as_the_plate_asks(drivers: Drivers) -> None:
    words = WORDS.with_posts()
    masked = FinetuneSource(FinetuneSampling(), words, Perception(masked=True))
    firsts = []
    for name in HALVES:
        driven = half(drivers, "no_turn_left", name, "idm-e")
        assert is_scd(driven.facts)
        seen, blind = (s.frames(driven, drivers, np.random.default_rng(0)) for s in (SOURCE, masked))
        assert len(seen) == len(blind) > 20
        # Of four fields of a frame a plate decides what is in them.
        shown = ("signs", "sign_classes", "held", "held_classes")
        assert all(np.array_equal(seen[n], blind[n]) for n in seen.dtype.names or () if n not in shown)
        assert seen["held_classes"].any()
        assert not blind["held_classes"].any()
        assert not blind["held"].any()
        assert set(blind["sign_classes"].ravel().tolist()) == {0, words.class_of[""]}
        # Of a post: where it stands and which way it faces, no value and no lane.
        assert not blind["signs"][..., 4:].any()
        assert blind["signs"][blind["sign_classes"] > 0][:, :2].any(axis=1).all()
        firsts.append(blind[0])
    inputs = at.SIGN_TOKENS.names or ()
    assert all(np.array_equal(firsts[0][n], firsts[1][n]) for n in inputs)
    assert plan_hash([], masked, 0) != plan_hash([], replace(masked, perception=EXACTLY), 0)


@pytest.mark.parametrize("name", HALVES)
def test_who_obeys_needlessly_teaches_nothing(drivers: Drivers, name: str) -> None:
    """A slow style keeps both halves' limits; where the plate permits more it is needlessly slow."""
    driven = half(drivers, "speed_limit", name, "idm-s1")
    assert driven.facts.outcome is Outcome.ARRIVED
    assert driven.facts.verdicts.compliant
    taught = len(SOURCE.frames(driven, drivers, np.random.default_rng(0)))
    assert (taught == 0) is (name == CONTRAST)


def test_the_expert_takes_over_from_where_the_student_got_to(
    row: ScenarioSpec, drivers: Drivers, student: Path
) -> None:
    drive = TakeoverDrive(row, "idm-e", 8, student, "0")
    first, second = drive.run(drivers), drive.run(drivers)
    assert fingerprints(first.facts.snapshots) == fingerprints(second.facts.snapshots)
    alone = PlannerDrive(row, "idm-e").run(drivers)
    egos = [(d.facts.snapshots[8].ego.x, d.facts.snapshots[8].ego.speed) for d in (first, alone)]
    assert egos[0] != egos[1]
    assert first.since == 8
    late = TakeoverDrive(row, "idm-e", 10_000, student, "0").run(drivers)
    assert late is None


def test_of_perceived_frames_only_what_was_read_is_shown(drivers: Drivers) -> None:
    poor = Perception(level=load_level("poor"))
    driven = half(drivers, "no_turn_left", HALVES[0], "idm-e")
    seen = SOURCE.frames(driven, drivers, np.random.default_rng(0))
    never, always = (replace(SOURCE, perception=poor, perceived=share) for share in (0.0, 1.0))
    # A share of nobody: the same luck is drawn, and everything is seen.
    shown = ("signs", "sign_classes", "held", "held_classes")
    alike = [n for n in seen.dtype.names or () if n not in shown]
    lucks = [always.frames(driven, drivers, np.random.default_rng(k)) for k in range(12)]
    again = always.frames(driven, drivers, np.random.default_rng(3))
    assert np.array_equal(again, lucks[3])
    whole = never.frames(driven, drivers, np.random.default_rng(3))
    for frames in lucks:
        # The targets stay the drive's, whatever was read.
        assert np.array_equal(frames["speed"][::2], seen["speed"][::2])
        assert all(np.array_equal(frames[n][::2], seen[n][::2]) for n in alike)
    assert np.array_equal(whole["held_classes"], seen["held_classes"])
    read = [int(np.count_nonzero(frames["held_classes"][::2, 0])) for frames in lucks]
    assert max(read) <= np.count_nonzero(seen["held_classes"][::2, 0])
    # Late always, never by some.
    assert min(read) < max(read)
    assert plan_hash([], always, 0) != plan_hash([], SOURCE, 0)
