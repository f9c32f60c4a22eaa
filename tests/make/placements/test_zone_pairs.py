"""Pairs of scenes at junctions, obstacles and in zones: what differs between their halves; no drive passes both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from lxml import etree
from pool_builders import built_site, corridor, crossroads, recipe_of, two_way
from simworld import FAST, cross_plain, loader_of, road_plain, simulation

from tsbench.episode.runner import EpisodeRunner
from tsbench.make.certify.certifier import Certifier
from tsbench.make.maps.plain import PlainNet
from tsbench.make.scenes.map_scenarios import MapScenarios
from tsbench.metrics.scd import is_scd
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.observation import Observation
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.scenarios.store import SceneFolder
from tsbench.sim.convoy import LATE_BRAKE_MPS2
from tsbench.sim.scene_file import read_additional

ROAD: tuple[PoolRow, PlainNet] = (corridor(speed=FAST), road_plain(speed=FAST))
LIMITS = ("speed_limit", "zone_speed_limit")
DETOURS = ("detour_right", "detour_left")
PRIORITY = ("yield", "secondary_road", "stop", "main_road")
MAPS = {
    **dict.fromkeys(("speed_limit", "min_speed", "bus_lane", "bike_lane"), two_way()),
    "zone_speed_limit": two_way("tertiary"),
    "residential_zone": two_way("residential", 11.11),
    **dict.fromkeys(DETOURS, ROAD),
    "blocked_road": (crossroads(), cross_plain()),
    **dict.fromkeys(PRIORITY, (crossroads(), cross_plain())),
}


@dataclass(frozen=True)
class Built:
    """The proven site of a type, and where its files are."""

    site: MapScenarios
    root: Path

    @property
    def pairs(self) -> list[tuple[ScenarioSpec, ScenarioSpec]]:
        rows = self.site.rows
        return list(zip(rows[::2], rows[1::2], strict=True))


@pytest.fixture(scope="module", params=MAPS)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The first variant of one type that has traffic."""
    # Of the crossroads' arms two are closed: there is no room for more.
    most = 3.0 if request.param == "blocked_road" else math.inf
    root, recipe = tmp_path_factory.mktemp("pairs"), recipe_of(request.param)
    prover = Certifier(simulation(), loader_of(root))
    made = MAPS[request.param]
    site = built_site(recipe, root, made, lambda all_: [v for v in all_ if v.density < most][1:2], prover, "train")
    assert site.reason == ""
    return Built(site, root)


def test_the_certificates_of_pairs(built: Built) -> None:
    for spec, certificate in zip(built.site.rows, built.site.certificates, strict=True):
        assert (certificate.solvable, certificate.exclusive, certificate.blind_equal) == (True, True, True)
        # Others do nothing else in the other half: no vehicle betrays the plate.
        assert certificate.differs_s is None or certificate.brake_mps2 > LATE_BRAKE_MPS2
        # A driver that drives on in its lane without a look at the plate breaks the one, and keeps the other unless
        # this is a limit below the road's own; at an obstacle it gets nowhere.
        low = spec.pair_type in LIMITS and (spec.sign_value or 0.0) < FAST * 3.6 - 0.5
        assert certificate.tempting == (spec.half != CONTRAST or spec.pair_type in DETOURS or low)


def without_what_hangs_on_posts(root: etree._Element) -> bytes:
    """A scene file but for its plates' prints and the clauses: of each post only where it stands and faces."""
    for clause in root.findall("poi[@type='contrast']"):
        root.remove(clause)
    for post in root.iterfind("poi[@type='sign']"):
        for child in list(post):
            post.remove(child)
        for key in ("id", "color"):
            del post.attrib[key]
    for target in root.iter("param"):
        if target.get("key") == "target":
            target.attrib.pop("value")
    return etree.tostring(root)


def test_only_what_hangs_on_the_posts_differs(built: Built) -> None:
    for signed, contrast in built.pairs:
        assert (contrast.half, contrast.pair_id) == (CONTRAST, signed.scenario_id)
        assert contrast.seed == signed.seed
        # SUMO's own drivers obey the plates that say who goes first.
        assert (contrast.net != signed.net) == (signed.scenario_type in PRIORITY)
        folder = SceneFolder(built.root)
        one, other = (
            without_what_hangs_on_posts(
                read_additional(built.root / spec.additional, folder.read(spec, spec.additional).content)
            )
            for spec in (signed, contrast)
        )
        assert one == other


class Crawler(Idm):
    """Never faster than 20 km/h."""

    def __init__(self) -> None:
        super().__init__(IdmParameters(top_speed=20.0 / 3.6))


class Doubter:
    """Stands for three and a half seconds just before the first post that it comes to, and then drives on."""

    def __init__(self) -> None:
        self._driver, self._stood = Idm(), 0.0

    def reset(self, context: PlannerContext) -> None:
        self._driver, self._stood = Idm(), 0.0
        self._driver.reset(context)

    def act(self, observation: Observation) -> Control:
        command, (x, y) = self._driver.act(observation), observation.ego.front
        reach = 4.0 + observation.ego.speed**2 / 12.0
        near = any((s.x - x) ** 2 + (s.y - y) ** 2 < reach**2 for s in observation.signs)
        if not near or self._stood >= 3.5:
            return command
        self._stood += 0.1 * (observation.ego.speed < 0.1)
        return replace(command, acceleration=-6.0)


@pytest.mark.parametrize("driver", [Crawler, Doubter])
def test_who_hesitates_does_not_pass_both(built: Built, driver: type[Crawler | Doubter]) -> None:
    planner = LoadedPlanner("blind", lambda **_: driver())
    runner = EpisodeRunner(planner, simulation=simulation(), loader=loader_of(built.root))
    for pair in built.pairs:
        results = [runner.run(spec) for spec in pair]
        assert all(r.facts is not None for r in results), results[0].error
        assert sum(r.facts is not None and is_scd(r.facts) for r in results) < 2
