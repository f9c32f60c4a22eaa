from __future__ import annotations

import math

import numpy as np
import pytest

from tsbench.geometry.polyline import Polyline
from tsbench.roads.network import Crossing
from tsbench.rules.crossing import CrossingPeople
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import EGO_WIDTH_M, ActorKind, Actors, ActorTable

# From kerb to kerb along y, from (0, 0) to (0, 7); the ego drives along x at y = 1.75.
CROSSING = Crossing("c", ("e",), Polyline([(0.0, 0.0), (0.0, 7.0)]), 4.0)
DEPTH = 0.3
STRIP = 1.75 + EGO_WIDTH_M / 2


def _in_the_way(x: float, y: float, heading_deg: float, speed: float = 1.4) -> bool:
    table = ActorTable(1)
    table.add("p", ActorKind.PEDESTRIAN, DEPTH, 0.5, ())
    pose = np.array([[x, y, math.radians(heading_deg)]])
    actors = Actors(
        table, np.zeros(1, dtype=np.int32), pose, np.array([speed]), np.array([-1], dtype=np.int32), np.zeros(1)
    )
    people = CrossingPeople(CROSSING, load_catalog().rule("crosswalk").thresholds)
    return people.anyone_in_the_way(-35.0, 1.75, 0.0, actors, [0])


@pytest.mark.parametrize(("past", "expected"), [(0.98, True), (1.02, False)])
def test_who_walks_away_is_in_the_way_until_it_is_clear_of_the_strip(past: float, expected: bool) -> None:
    assert _in_the_way(0.0, STRIP + DEPTH / 2 + past, 90.0) is expected


def test_who_walks_towards_the_strip_is_in_the_way_from_the_far_kerb_on() -> None:
    assert _in_the_way(0.0, 6.9, -90.0)
    assert not _in_the_way(0.0, 6.9, 90.0)


@pytest.mark.parametrize(
    ("y", "heading_deg", "speed", "expected"),
    [
        (-1.9, 90.0, 1.4, True),
        (-2.1, 90.0, 1.4, False),
        (-1.0, 90.0, 0.05, False),
        (-1.0, -90.0, 1.4, False),
        (-1.0, 31.0, 1.4, True),
        (-1.0, 29.0, 1.4, False),
        (8.0, -90.0, 1.4, True),
    ],
)
def test_who_walks_towards_the_kerb_is_about_to_step(
    y: float, heading_deg: float, speed: float, expected: bool
) -> None:
    assert _in_the_way(0.0, y, heading_deg, speed) is expected


def test_who_is_beside_the_crossing_is_not_in_the_way() -> None:
    assert not _in_the_way(2.1, 3.0, 90.0)
    assert not _in_the_way(4.1, -1.0, 90.0)
