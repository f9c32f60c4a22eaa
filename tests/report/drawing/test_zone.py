"""The ground that each type's rule is about, on committed scenes: it is there, near its plate, and in one piece."""

from __future__ import annotations

import pytest
import shapely

from tsbench.report.drawing.zone import rule_zone
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path


@pytest.fixture(scope="module")
def first_of_each() -> dict[str, ScenarioSpec]:
    """The first test row of each type that there is."""
    found: dict[str, ScenarioSpec] = {}
    for row in read_table(table_path("test")):
        found.setdefault(row.scenario_type, row)
    return found


def test_every_type_has_its_zone_near_the_plate(first_of_each: dict[str, ScenarioSpec]) -> None:
    loader = SceneLoader()
    for kind, row in first_of_each.items():
        scene, _ = loader.load(row)
        zone = rule_zone(scene)
        assert zone is not None, kind
        assert zone.area > 3.0, kind
        sign = scene.target_sign
        assert zone.distance(shapely.Point(sign.x, sign.y)) < 120.0, kind
        # Closing hairlines between strips that only touch, it is one piece; a ring has a hole.
        whole = zone.buffer(0.3)
        assert whole.geom_type == "Polygon", kind
        if kind == "roundabout":
            assert len(whole.interiors) >= 1
