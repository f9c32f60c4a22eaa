"""The second seed is a network of its own, of the same kind and the same lessons."""

from __future__ import annotations

import numpy as np
from learned_scenes import record

from tsbench.planners.plant2.planner_ft import Plant2Ft
from tsbench.planners.plant2.seeds import SecondSeed
from tsbench.planners.weights import network


def test_it_drives_with_weights_of_its_own() -> None:
    drive = record()
    told = []
    for planner in (Plant2Ft(), SecondSeed()):
        planner.reset(drive.context)
        told.append(np.array([planner.act(o).acceleration for o in drive.seen[:10]]))
    assert np.isfinite(told).all()
    assert not np.array_equal(*told)


def test_the_lessons_were_the_same_but_for_the_seed() -> None:
    first, second = (dict(network(name).training) for name in ("plant2-ft", "plant2-ft-seed1"))
    assert (first["seed"], second["seed"]) == (0, 1)
    for key in [
        "size",
        "epochs",
        "batch",
        "rate",
        "drivers",
        "perception",
        "perceived",
        "drives",
        "more",
        "sampling",
    ]:
        assert first[key] == second[key], key
