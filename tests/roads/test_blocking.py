"""Who blocks the ego, on the crossing and the merging paths of small junctions."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.blocking import PriorityGap, arrival_s, blocker, blockers, clearance_s
from tsbench.roads.junction_paths import JunctionPath, junction_paths, path_zones
from tsbench.roads.network import read_network
from tsbench.roads.priority import PriorityVehicle
from tsbench.signs.catalog import load_catalog

ASKED = PriorityGap(before=4.0, after=1.0, least=2.0)


def _zone(own: tuple[str, str], other: tuple[str, str]) -> ConflictZone:
    net = read_network(Path(__file__).parent.parent / "cases" / "nets" / "x.net.xml")

    def between(source: str, target: str) -> JunctionPath:
        return next(p for p in junction_paths(net, (source,)) if p.target.edge == target)

    zone = path_zones((between(*own),), (between(*other),), least_overlap=0.5)[0][0]
    assert zone is not None
    return zone


CROSSING = _zone(("s_in", "n_out"), ("w_in", "e_out"))
MERGING = _zone(("s_in", "e_out"), ("w_in", "e_out"))


def _vehicle(s: float, speed: float, path: int = 0) -> PriorityVehicle:
    return PriorityVehicle(0, 7, path, s, 4.5, speed)


def test_the_numbers_are_those_of_the_rule() -> None:
    assert PriorityGap.of(load_catalog().rule("give_way").thresholds) == ASKED


@pytest.mark.parametrize(("speed", "counted"), [(8.0, 8.0), (2.0, 2.0), (1.0, 2.0), (0.0, 2.0)])
def test_who_comes_blocks_while_it_would_be_there_in_less_than_the_gap(speed: float, counted: float) -> None:
    for seconds, blocks in ((3.99, True), (4.01, False)):
        vehicle = _vehicle(CROSSING.b_in - seconds * counted, speed)
        assert arrival_s(vehicle, CROSSING, 2.0) == pytest.approx(seconds)
        found = blocker(vehicle, CROSSING, 0.0, 5.0, ASKED)
        assert (found is not None) == blocks
        if found is not None:
            assert found.gap == pytest.approx(seconds)
            assert found.asked == 4.0


def test_who_is_in_the_zone_blocks_who_would_be_there_before_it_is_gone_and_a_second() -> None:
    # Its rear has 4 m to go at 8 m/s: 0.5 s. All ground of two roads that cross squarely begins at the ego's near edge.
    vehicle = _vehicle(CROSSING.b_out + 4.5 - 4.0, 8.0)
    for seconds, blocks in ((1.49, True), (1.51, False)):
        front = CROSSING.a_in - seconds * 5.0
        assert clearance_s(vehicle, CROSSING, front, 5.0, 2.0) == pytest.approx(seconds - 0.5, abs=0.03)
        found = blocker(vehicle, CROSSING, front, 5.0, ASKED)
        assert (found is not None) == blocks
    # Standing, the ego is counted as at 2 m/s.
    assert blocker(vehicle, CROSSING, CROSSING.a_in - 2.9, 0.0, ASKED) is not None
    assert blocker(vehicle, CROSSING, CROSSING.a_in - 3.1, 0.0, ASKED) is None


def test_who_has_left_the_zone_blocks_nobody() -> None:
    gone = _vehicle(CROSSING.b_out + 4.51, 0.0)
    assert clearance_s(gone, CROSSING, CROSSING.a_in, 5.0, 2.0) is None
    assert blocker(gone, CROSSING, CROSSING.a_in, 5.0, ASKED) is None
    assert blocker(_vehicle(CROSSING.b_out + 4.49, 0.0), CROSSING, CROSSING.a_in, 5.0, ASKED) is not None


def test_where_paths_merge_the_ground_behind_a_rear_is_free() -> None:
    ahead = _vehicle(MERGING.b_in + 4.5 + 6.0, 8.0)
    assert blocker(ahead, MERGING, MERGING.a_in, 3.0, ASKED) is None
    # The same one standing there, and the ego fast: it would run into it.
    assert blocker(ahead._replace(speed=0.0), MERGING, MERGING.a_in, 10.0, ASKED) is not None
    # Just in: the ego's first ground is under it.
    assert blocker(_vehicle(MERGING.b_in + 0.1, 8.0), MERGING, MERGING.a_in, 3.0, ASKED) is not None


def test_blockers_come_in_order_and_by_their_own_paths() -> None:
    zones = (CROSSING, None, MERGING)
    near = [_vehicle(-5.0, 8.0, path) for path in (2, 1, 0)]
    assert [b.vehicle.path for b in blockers(near, zones, -3.0, 5.0, ASKED)] == [2, 0]
    assert blockers([_vehicle(-60.0, 8.0)], zones, -3.0, 5.0, ASKED) == []


def test_ground_lies_within_its_zone_and_begins_farther_on_along_a_merge() -> None:
    for zone in (CROSSING, MERGING):
        ends, begins = zip(*zone.ground, strict=True)
        assert list(ends) == sorted(ends)
        assert ends[-1] == pytest.approx(zone.b_out)
        assert all(zone.a_in <= a <= zone.a_out for a in begins)
        assert min(begins) == pytest.approx(zone.a_in, abs=0.3)
    assert MERGING.ground[-1][1] > MERGING.a_in + 2.0
