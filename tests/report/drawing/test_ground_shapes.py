"""Buildings and greenery in pictures: beside the roads, turned where the city is, and nowhere else."""

from __future__ import annotations

import numpy as np
import shapely

from tsbench.core.paths import using_city
from tsbench.report.drawing.ground import ground_shapes
from tsbench.report.drawing.roads import road_shapes
from tsbench.report.drawing.shapes import Area
from tsbench.report.drawing.style import STYLE
from tsbench.report.page.drawing import drawing
from tsbench.report.video.render import scene_picture
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.table import read_table, table_path


def test_buildings_stand_beside_the_roads() -> None:
    """Of a shipped city: were its file in another frame, houses would stand on lanes."""
    with using_city("north-bayreuth"):
        rows = {row.map_id: row for row in read_table(table_path("dev"))}
        on_roads = houses = 0.0
        for row in rows.values():
            built = [one.polygon for one in ground_shapes(row.map_id) if one.colour == "building"]
            shapes = list(road_shapes(load_scene(row).network))
            asphalt = shapely.union_all(
                [s.polygon for s in shapes if isinstance(s, Area) and s.colour == "asphalt"]
            )
            houses += sum(shape.area for shape in built)
            on_roads += sum(shape.intersection(asphalt).area for shape in built)
    assert houses > 1_000.0
    assert on_roads < 0.01 * houses


def test_a_mirror_turns_them_and_moscow_has_none() -> None:
    with using_city("north-bayreuth"):
        row = next(row for row in read_table(table_path("dev")) if ground_shapes(row.map_id))
        own = ground_shapes(row.map_id)
        page = scene_picture(load_scene(row), "title", map_id=row.map_id)
        bare = scene_picture(load_scene(row), "title")
    with using_city("mirrored-north-bayreuth"):
        turned = ground_shapes(row.map_id)
    for one, other in zip(own, turned, strict=True):
        left, low, right, high = one.polygon.bounds
        assert other.polygon.bounds == (-right, low, -left, high)
        assert other.colour == one.colour
    assert ground_shapes(row.map_id) == ()
    # It is in pictures, and pages take the same shapes.
    colour = np.array(getattr(STYLE, own[-1].colour))
    assert (page == colour).all(axis=2).any()
    assert not (bare == colour).all(axis=2).any()
    assert {area["c"] for area in drawing(own)["areas"]} == {one.colour for one in own}
