"""The line of a plate in pictures is the one that its rule judges."""

from __future__ import annotations

import numpy as np
import pytest

from tsbench.report.drawing.scene import plate_line
from tsbench.rules.monitors import make_monitor
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import EGO_LENGTH_M, EgoState


@pytest.mark.parametrize(
    ("kind", "monitor_line"),
    [("stop", "line"), ("no_turn_right", "_line"), ("crosswalk", "_begin"), ("no_entry", "_plate")],
)
def test_a_front_on_the_drawn_line_is_on_the_judged_one(kind: str, monitor_line: str) -> None:
    row = next(r for r in read_table(table_path("dev")) if r.scenario_type == kind and r.half == "signed")
    scene = load_scene(row)
    sign = scene.target_sign
    monitor = make_monitor(sign, load_catalog(), scene)
    lane = scene.network.edge_lanes(sign.edge)[0]
    drawn = plate_line(scene.network, sign)
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
