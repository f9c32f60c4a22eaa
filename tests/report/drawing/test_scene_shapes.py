"""The zone of a target's rule, and the line of its plate, on committed scenes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from tsbench.report.drawing.scene_shapes import plate_line, rule_zones
from tsbench.rules.monitors import make_monitor
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader, load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.world import EGO_LENGTH_M, EgoState


@pytest.fixture(scope="module")
def first_of_each() -> dict[str, ScenarioSpec]:
    """The first test row of each type that there is."""
    found: dict[str, ScenarioSpec] = {}
    for row in DataSet().table("test"):
        found.setdefault(row.scenario_type, row)
    return found


def test_every_type_has_its_zone_near_the_plate(first_of_each: dict[str, ScenarioSpec]) -> None:
    loader = SceneLoader(DataSet())
    for kind, row in first_of_each.items():
        scene, _ = loader.load(row)
        (zone,) = rule_zones(scene)
        assert zone.area > 3.0, kind
        sign = scene.target_signs[0]
        assert zone.distance(shapely.Point(sign.x, sign.y)) < 120.0, kind
        # Closing hairlines between strips that only touch, it is one piece; a ring has a hole.
        whole = zone.buffer(0.3)
        assert whole.geom_type == "Polygon", kind
        if kind == "roundabout":
            assert len(whole.interiors) >= 1


@pytest.mark.parametrize(
    ("kind", "monitor_line"),
    [("stop", "line"), ("no_turn_right", "_line"), ("crosswalk", "_begin"), ("no_entry", "_plate")],
)
def test_a_front_on_the_drawn_line_is_on_the_judged_one(kind: str, monitor_line: str) -> None:
    row = next(r for r in DataSet().table("dev") if r.scenario_type == kind and r.half == "signed")
    scene = load_scene(DataSet(), row)
    sign = scene.target_signs[0]
    monitor = make_monitor(sign, scene)
    lane = scene.network.edge_lanes(sign.edge)[0]
    drawn = plate_line(scene, sign)
    kerb_end = drawn[0]
    s = lane.line.project(*kerb_end.tolist())[0]
    ego = EgoState(
        *lane.line.point_at(s - EGO_LENGTH_M / 2), lane.line.heading_at(s), 5.0, 0.0, 0.0, 0.0,
        lane.index, s - EGO_LENGTH_M / 2, 0.0, True,
    )  # fmt: skip
    line = getattr(monitor, monitor_line)
    to_go = line.to_go(ego) if hasattr(line, "to_go") else line - monitor._road.front(ego)  # type: ignore[attr-defined]
    assert to_go == pytest.approx(0.0, abs=0.1)
    lanes = scene.network.edge_lanes(sign.edge)
    assert np.hypot(*(drawn[0] - drawn[1])) == pytest.approx(sum(one.width for one in lanes), abs=1.0)
