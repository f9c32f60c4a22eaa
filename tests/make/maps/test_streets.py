"""OSMnx's statistics of a street network that is known by heart."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.make.maps.streets import draw_bearings, graph_of, streets_of

# Three streets each way, 0.001 degrees of latitude apart (111.2 m), at the equator: a square grid.
STEP = 0.001
EDGE_M = 111.2


def grid(path: Path, more: str = "") -> Path:
    nodes = "".join(
        f'<node id="{10 * row + column + 1}" lat="{row * STEP}" lon="{9.0 + column * STEP}"/>'
        for row in range(3)
        for column in range(3)
    )
    ways = [[10 * row + column + 1 for column in range(3)] for row in range(3)]
    ways += [[10 * row + column + 1 for row in range(3)] for column in range(3)]
    roads = ""
    for k, way in enumerate(ways):
        nodes_of = "".join(f'<nd ref="{n}"/>' for n in way)
        roads += f'<way id="{100 + k}">{nodes_of}<tag k="highway" v="residential"/></way>'
    path.write_text(f'<osm version="0.6">{nodes}{roads}{more}</osm>')
    return path


def test_a_grid(tmp_path: Path) -> None:
    # A footway and a road that is closed to cars are no streets.
    more = "".join(
        f'<way id="{k}"><nd ref="1"/><nd ref="23"/>{tags}</way>'
        for k, tags in (
            (900, '<tag k="highway" v="footway"/>'),
            (901, '<tag k="highway" v="residential"/><tag k="motor_vehicle" v="no"/>'),
        )
    )
    graph = graph_of(grid(tmp_path / "grid.osm", more))
    told = streets_of("grid", graph)
    # Twelve streets of one step; four corners are bends of a street, and no intersections.
    assert told.street_km == pytest.approx(12 * EDGE_M / 1e3, rel=0.01)
    assert told.intersections == 5
    assert told.arms == {3: 0.8, 4: 0.2, 5: 0.0}
    assert told.dead_ends == 0.0
    assert told.area_km2 == pytest.approx((2 * EDGE_M) ** 2 / 1e6, rel=0.02)
    assert told.density == told.intersections / told.area_km2
    assert told.circuity >= 1.0 - 1e-6
    draw_bearings({"grid": graph, "again": graph}, tmp_path / "rose.png")
    assert (tmp_path / "rose.png").read_bytes().startswith(b"\x89PNG")


def test_the_entropy_of_a_grid_is_that_of_four_directions(tmp_path: Path) -> None:
    # Ends beyond the grid: all nodes of it are intersections, and all streets run north or east.
    ends = '<node id="91" lat="-0.001" lon="9.0"/><node id="92" lat="0.003" lon="9.002"/>'
    ways = "".join(
        f'<way id="{950 + k}"><nd ref="{a}"/><nd ref="{b}"/><tag k="highway" v="residential"/></way>'
        for k, (a, b) in enumerate(((91, 1), (23, 92)))
    )
    told = streets_of("grid", graph_of(grid(tmp_path / "grid.osm", ends + ways)))
    assert told.entropy < math.log(36) / 1.5
    assert told.dead_ends > 0.0


def test_an_extract_without_roads_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.osm"
    path.write_text('<osm version="0.6"><node id="1" lat="1" lon="9"/></osm>')
    with pytest.raises(InputError, match=r"empty\.osm"):
        graph_of(path)
