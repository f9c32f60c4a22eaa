"""What `plant2-ft` is with another seed, and without its hand-written parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learned_scenes import Recorder, record

from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.ablations import InSight, SecondSeed, WithoutHalts, WithoutMemory
from tsbench.learn.plant2.plant2_planner import Plant2Ft
from tsbench.learn.plant2.sign_tokens import SignMemory, vocabulary_of
from tsbench.planners.base import SignView
from tsbench.planners.weights import network
from tsbench.sim.world import EGO_LENGTH_M


@pytest.fixture(scope="module")
def drive() -> Recorder:
    return record()


def plan_that_stands() -> np.void:
    plan = np.zeros(1, dtype=at.PLAN)[0]
    plan["speed"], plan["standing"] = 1.5, 0.9
    return plan


def test_without_halts_it_drives_at_the_mean_speed(drive: Recorder) -> None:
    whole, bare = Plant2Ft(), WithoutHalts()
    for planner in (whole, bare):
        planner.reset(drive.context)
    assert whole.target_speed(plan_that_stands()) == 0.0
    assert bare.target_speed(plan_that_stands()) == 1.5


def test_without_memory_a_plate_out_of_sight_is_gone_and_a_stop_forgotten(drive: Recorder) -> None:
    o = drive.seen[0]
    line = next(piece.s1 for piece in o.route.path.pieces if o.route.s <= piece.s1)
    before_line = replace(o.route, s=line - 2.0 - EGO_LENGTH_M / 2)
    x, y, heading = (o.ego.x + 2.0 * np.cos(o.ego.heading), o.ego.y + 2.0 * np.sin(o.ego.heading), o.ego.heading)
    stop = SignView("2.5", None, x, y, heading, o.route.path.edges[0], -1, 0.0, 2.0)
    stands = replace(o, route=before_line, ego=replace(o.ego, speed=0.0), signs=(stop,))
    words = vocabulary_of()
    told = []
    for kind in (SignMemory, InSight):
        memory, rows = kind(drive.context.network, words), np.zeros(2, dtype=at.SIGN_TOKENS)
        for row, seen in zip(rows, (stands, replace(stands, step=o.step + 1, signs=())), strict=True):
            memory.update(seen)
            memory.fill(row, seen, 0)
        told.append([(bool(row["held_classes"][0]), float(row["held"][0, -1])) for row in rows])
    assert told == [[(True, 1.0), (True, 1.0)], [(True, 0.0), (False, 0.0)]]
    planner = WithoutMemory()
    planner.reset(drive.context)
    assert isinstance(planner._signs._memory, InSight)


def test_the_second_seed_drives_with_weights_of_its_own(drive: Recorder) -> None:
    told = []
    for planner in (Plant2Ft(), SecondSeed()):
        planner.reset(drive.context)
        told.append(np.array([planner.act(o).acceleration for o in drive.seen[:10]]))
    assert np.isfinite(told).all()
    assert not np.array_equal(*told)


def test_the_lessons_of_the_second_seed_were_the_same() -> None:
    first, second = (dict(network(name).training) for name in ("plant2-ft", "plant2-ft-seed1"))
    assert (first["seed"], second["seed"]) == (0, 1)
    lessons = ("size", "epochs", "batch", "rate", "drivers", "perceived", "drives", "more", "sampling")
    for key in ("perception", *lessons):
        assert first[key] == second[key], key
