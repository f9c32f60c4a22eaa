"""Whose fault a contact is."""

from __future__ import annotations

import math

import episode_builders as made
import numpy as np
import pytest

from tsbench.episode.outcome import contact_at_fault

LANE = -4.8


@pytest.mark.parametrize(
    ("what", "ego_speed", "pose", "speed", "fault"),
    [
        ("runs into a standing one", 5.0, (4.2, LANE, 0.0), 0.0, True),
        ("runs into a slower one", 9.0, (4.2, LANE, 0.0), 5.0, True),
        ("stands and is hit in front", 0.0, (4.2, LANE, math.pi), 8.0, False),
        ("stands and is hit from behind", 0.0, (-4.2, LANE, 0.0), 8.0, False),
        ("drives and is hit from behind", 5.0, (-4.2, LANE, 0.0), 9.0, False),
        ("head-on", 5.0, (4.2, LANE, math.pi), 9.0, True),
        ("hits a crossing one in its side", 5.0, (3.2, LANE, math.pi / 2), 9.0, True),
        ("is hit in its rear side by a crossing one", 5.0, (-1.8, LANE - 2.8, math.pi / 2), 9.0, False),
        ("swerves into one beside it", 6.0, (0.5, LANE + 1.8, 0.0), 6.0, True),
        ("swerves into one that it overtakes", 9.0, (-2.5, LANE + 1.8, 0.0), 6.0, True),
        ("scrapes a parked one", 4.0, (-1.0, LANE + 1.9, 0.0), 0.0, True),
    ],
)
def test_fault(what: str, ego_speed: float, pose: tuple[float, float, float], speed: float, fault: bool) -> None:
    ego = made.ego(0.0, LANE, speed=ego_speed)
    assert contact_at_fault(ego, np.array(pose), speed, 4.0, 2.0) is fault, what


@pytest.mark.parametrize("turn", [0.4, 2.0, -3.0])
def test_fault_does_not_depend_on_the_frame(turn: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    for pose, fault in (((3.2, 0.0, math.pi / 2), True), ((-1.8, -2.8, math.pi / 2), False)):
        x, y, heading = pose
        turned = np.array([x * c - y * s, x * s + y * c, heading + turn])
        ego = made.ego(0.0, 0.0, heading=turn, speed=5.0)
        assert contact_at_fault(ego, turned, 9.0, 4.0, 2.0) is fault
