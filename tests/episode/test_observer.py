"""Which plates are told by their code, and which by their outline alone."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tsbench.episode.observer import Observer
from tsbench.episode.perception_level import Perception
from tsbench.planners.observation import SignView
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.sim.world import Actors, ActorTable, EgoState, WorldSnapshot

LOADER = SceneLoader(DataSet())


class Watch:
    """An observer of dev's first scene of a type and half, asked from places of the test's choice."""

    def __init__(self, kind: str, half: str = "signed", perception: Perception | None = None) -> None:
        rows = DataSet().table("dev")
        row = next(r for r in rows if (r.scenario_type, r.half) == (kind, half))
        self.scene, roads = LOADER.load(row)
        self._observer = Observer(self.scene, roads.view, perception or Perception())
        self._step = 0

    def target_from(self, ahead: float) -> SignView:
        """The target as it is told to an ego so many metres before its face; behind it where that is negative."""
        sign = self.scene.target_signs[0]
        cos, sin = math.cos(sign.heading), math.sin(sign.heading)
        x, y = sign.x - ahead * cos, sign.y - ahead * sin
        ego = EgoState(x, y, sign.heading, 5.0, 0.0, 0.0, 0.0, -1, 0.0, 0.0, True)
        real = np.zeros(0)
        nobody = Actors(ActorTable(1), np.zeros(0, np.int32), np.zeros((0, 3)), real, np.zeros(0, np.int32), real)
        route: Any = None
        seen = self._observer.observe(WorldSnapshot(self._step, 0.1 * self._step, ego, nobody), ego, route)
        self._step += 1
        return next(s for s in seen.signs if (s.x, s.y) == (sign.x, sign.y))


def test_from_behind_only_the_outline_is_told() -> None:
    watch = Watch("stop")
    sign, seen = watch.scene.target_signs[0], watch.target_from(-20.0)
    assert (seen.code, seen.value, seen.lane, seen.main_road, seen.outline) == ("", None, -1, (), "octagon")
    assert not replace(seen, temporary=True).from_behind().temporary
    assert not replace(seen, temporary=True).masked().temporary
    assert (seen.heading, seen.distance) == (sign.heading, pytest.approx(20.0))
    assert seen.edge
    assert math.isfinite(seen.position_m)


def test_what_has_faced_the_ego_stays_read() -> None:
    watch = Watch("speed_limit")
    assert watch.target_from(-10.0).code == ""
    front = watch.target_from(60.0)
    assert (front.code, front.value) == ("3.24", watch.scene.target_signs[0].value)
    assert (front.outline, front.main_road) == ("circle", ())
    passed = watch.target_from(-10.0)
    assert (passed.code, passed.value) == (front.code, front.value)


def test_the_main_road_is_told_with_the_plate_that_faces_the_ego() -> None:
    watch = Watch("main_road")
    assert watch.target_from(-10.0).main_road == ()
    right, own = watch.target_from(40.0).main_road
    assert math.radians(-150.0) <= right <= math.radians(-30.0)
    assert own == math.pi
    assert Watch("main_road", "contrast").target_from(40.0).main_road == ()


def test_masked_plates_have_no_outline() -> None:
    for half in ("signed", "contrast"):
        seen = Watch("main_road", half, Perception(masked=True)).target_from(40.0)
        assert (seen.code, seen.outline, seen.main_road, seen.edge) == ("", "", (), "")
