"""A malformed catalogue ends in one line that names file and key."""

from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.signs.catalog import load_catalog


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("signs/2.4.yaml", "names:", "names: [", "line "),
        ("signs/2.4.yaml", 'code: "2.4"', 'code: "2.5"', "code: '2.5' stands in the file of '2.4'"),
        ("signs/2.4.yaml", "group: priority", "group: priorities", "group: 'priorities' is none of"),
        ("signs/2.4.yaml", "row: 3", "row: 4", "row 4 is that of 'yield'"),
        ("signs/2.4.yaml", "  name: give_way", "  name: politeness", "rule: name: 'politeness' is none of"),
        ("signs/2.4.yaml", "  name: give_way", "  name: give_way\n  thresholds: {gab_s: 3}", "gab_s: rule"),
        ("signs/2.4.yaml", "  name: give_way", "  name: give_way\n  options: {lane: x}", "lane: rule"),
        ("signs/2.4.yaml", "drawing: 2.4.svg", "drawing: none.svg", "plate: drawing: no file"),
        ("signs/2.4.yaml", "[0, 25]", "[25, 0]", "placement: distance_m: must be"),
        ("signs/2.4.yaml", "[junction]", "[sunset]", "ended_by: 'sunset' is neither"),
        ("signs/2.4.yaml", "[junction]", '["3.25"]', "ended_by: '3.25' is no sign that ends 2.4"),
        ("signs/2.1.yaml", "[junction, line,", "[crossroads, line,", "places: number 1: 'crossroads' is none of"),
        ("signs/2.1.yaml", "places: [junction, line, priority, open_road]\n", "", "places: is missing"),
        ("signs/2.1.yaml", "places: [junction,", "places: [road_speed,", "places: road_speed: the sign sets no value"),
        ("signs/3.24.yaml", "places: [road_speed,", "places: [begin,", "places: begin: the sign ends no other"),
        ("signs/3.24.yaml", "places: [road_speed, ", "places: [", "speeds: go with the place road_speed"),
        ("signs/3.24.yaml", "living_street: [20]", "living_street: [25]", "speeds: living_street: the sign sets no 25"),
        ("signs/5.19.yaml", "places: [crossing,", "places: [choice,", "places: choice: its rule permits no turns"),
        ("signs/2.1.yaml", '["2.4"]', '["2.9"]', "context: '2.9' is no sign"),
        ("signs/2.4.yaml", "[T, X]", "[T, T]", "maps: shapes: 'T' stands twice"),
        ("signs/2.4.yaml", "[T, X]", "[]", "maps: shapes: needs at least one"),
        ("signs/2.4.yaml", "family: junction", "family: corridor", "shapes: 'T' is none of straight, curved"),
        ("signs/2.3.2.yaml", "group: priority", "group: routing", "differs within 'secondary_road'"),
        ("signs/3.24.yaml", "[20, 30, 40, 50, 60, 70]", "[30, 20]", "value: posted: must be different numbers"),
        ("signs/3.25.yaml", 'ends: "3.24"', 'ends: "3.1"', "3.25' is no sign that ends 3.24"),
        ("signs/3.25.yaml", "id: speed_limit\n  row: 7", "id: other\n  row: 30", "differs from that of 3.24"),
        ("signs/4.2.1.yaml", "allowed_sides: [right]", "allowed_sides: [up]", "allowed_sides: 'up' is none of"),
        ("signs/4.2.1.yaml", "allowed_sides: [right]", "allowed_sides: []", "needs at least one word"),
        ("signs/4.2.1.yaml", "  options:\n    allowed_sides: [right]\n", "", "allowed_sides: is missing"),
        ("signs/5.14.1.yaml", "users: bus", "users: [bus, bicycle]", "users: must be one word"),
        ("rules/stop.yaml", "extends: give_way", "extends: nothing", "extends: 'nothing': no such rule"),
        ("rules/stop.yaml", "extends: give_way", "extends: roundabout", "extends another rule itself"),
        ("rules/stop.yaml", "rule: stop", "rule: halt", "rule: 'halt' stands in the file of 'stop'"),
        ("rules/speed.yaml", "{value:.1f}", "{speed:.1f}", "sentence: bad template"),
        ("rules/speed.yaml", "{value:.1f}", "{value:.1f", "sentence: bad template"),
        ("rules/give_way.yaml", "default: main_arms", "default: nobody", "default: 'nobody' is none of"),
        ("rules/give_way.yaml", "default: main_arms", "default: [main_arms, ring]", "default: must be one word"),
    ],
)
def test_malformed_files_give_one_line_with_file_and_key(
    edited: Callable[[str, str, str], Path], name: str, old: str, new: str, said: str
) -> None:
    root = edited(name, old, new)
    with one_line(str(root), said):
        load_catalog(root)


def test_a_catalogue_without_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no YAML files"):
        load_catalog(tmp_path)
