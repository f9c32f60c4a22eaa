"""Where plates can stand, and what breaks them: labelled cases, one pair for each kind of place and each rule."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import pytest
import yaml
from labelled import network

from tsbench.make.scenes.plate_checks import refused
from tsbench.make.scenes.plate_roads import PlateRoads
from tsbench.make.scenes.plate_surroundings import PlacedPlates, RoutedVehicle, broken_plates
from tsbench.make.scenes.verify import BROKEN, PlateFinding, finding_counts
from tsbench.roads.lane_graph import LaneGraph
from tsbench.signs.annotations import ALL_LANES, DISTRACTOR, SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.signs.model import Place
from tsbench.sim.scene import Obstacle

Case = dict[str, Any]
HERE = Path(__file__).parent
PLACES, DRIVEN = (
    yaml.safe_load((HERE / f"{name}_plates.yaml").read_text(encoding="utf-8")) for name in ("placed", "driven")
)
BESIDE_M = -2.8


def placed_cases(word: str) -> list[tuple[str, str]]:
    """Kind of place and name of each case that begins with a word."""
    return [(place, name) for place, cases in PLACES.items() for name in cases if name.startswith(word)]


def placed(case: Case) -> PlacedPlates:
    roads, catalog = network(case["net"]), load_catalog()

    def plate(number: int, code: str, edge: str, s: float, more: Case | None = None) -> SignInstance:
        given = more or {}
        line = roads.edge_lanes(edge)[0].line
        x, y = line.point_at(s, given.get("d", BESIDE_M))
        return SignInstance(
            f"sign_{number}", code, given.get("value"), edge, given.get("lane", ALL_LANES), s, x, y,
            line.heading_at(s), given.get("role", DISTRACTOR),
        )  # fmt: skip

    def vehicle(
        number: int, s: float, edges: list[str], speed: float = 10.0, vclass: str = "passenger"
    ) -> RoutedVehicle:
        return RoutedVehicle(f"car_{number}", vclass, tuple(edges), s, speed)

    def obstacle(number: int, lane: str, s: float) -> Obstacle:
        line = roads.lane(lane).line
        x, y = line.point_at(s)
        return Obstacle(f"obstacle_{number}", "island", x, y, line.heading_at(s), 4.0, 1.6, lane)

    return PlacedPlates(
        catalog,
        PlateRoads(graph=LaneGraph(roads), distances=catalog.distances),
        tuple(plate(k, *given) for k, given in enumerate(case["plates"])),
        tuple(obstacle(k, *given) for k, given in enumerate(case.get("obstacles", ()))),
        tuple(vehicle(k, *given) for k, given in enumerate(case.get("vehicles", ()))),
    )


def test_every_kind_has_cases_and_a_sign() -> None:
    assert list(PLACES) == list(get_args(Place))
    assert {place for sign in load_catalog().signs.values() for place in sign.places} == set(PLACES)


@pytest.mark.parametrize(("place", "name"), placed_cases("stands"))
def test_a_plate_that_can_stand(place: Place, name: str) -> None:
    scene = placed(PLACES[place][name])
    assert place in load_catalog().sign(scene.plates[0].code).places
    assert place not in dict(refused(scene, scene.plates[0]))


@pytest.mark.parametrize(("place", "name"), placed_cases("cannot"))
def test_a_plate_that_cannot(place: Place, name: str) -> None:
    case = PLACES[place][name]
    scene = placed(case)
    assert case["says"] in dict(refused(scene, scene.plates[0]))[place]


@pytest.mark.parametrize("rule", DRIVEN)
def test_a_way_that_keeps_a_plate(rule: str) -> None:
    scene = placed(DRIVEN[rule]["keeps"])
    assert load_catalog().sign(scene.plates[0].code).rule.name == rule
    assert broken_plates(scene, scene.vehicles[0]) == ()


@pytest.mark.parametrize("rule", DRIVEN)
def test_a_way_that_breaks_it(rule: str) -> None:
    case = DRIVEN[rule]["breaks"]
    scene = placed(case)
    ((broken, why),) = broken_plates(scene, scene.vehicles[0])
    assert broken is scene.plates[0]
    assert case["says"] in why


def test_counts_are_of_plates_and_rows() -> None:
    findings = [
        PlateFinding("a", "sign_0", "3.18.1", "target", "line", ""),
        PlateFinding("a", "sign_1", "3.18.2", DISTRACTOR, "line", ""),
        PlateFinding("b", "sign_1", "3.1", DISTRACTOR, BROKEN, "bg_0 drives past it"),
        PlateFinding("b", "sign_1", "3.1", DISTRACTOR, BROKEN, "bg_1 drives past it"),
    ]
    assert finding_counts(findings) == [
        ("broken", "3.1", 1, 0, 1),
        ("line", "3.18", 2, 1, 1),
        ("places", "all", 2, 1, 1),
        ("vehicles", "all", 1, 0, 1),
    ]
