"""What a pair's certificate says: two halves that no one drive passes, alike but for what the plates say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree
from simworld import SceneMaker, ego_at, loader_of, simulation, speed_plate, store_scenes

from tsbench.make.certify.certifier import Certifier, draw_sample, recertify
from tsbench.make.certify.evidence import AnswerReplay, Recorder, braking_before
from tsbench.make.scenes.traffic import Car
from tsbench.planners.base import Control
from tsbench.planners.registry import LoadedPlanner
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates, write_certificates
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.signs.contrast import ContrastClause, SlowZoneParams, contrast_to_poi
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import WorldSnapshot

# The zone of the contrast half: the road's own limit is 50 km/h, and who keeps 30 there is needlessly slow.
SLOW = ContrastClause("needless_slow", SlowZoneParams(("road",), 110.0, 190.0, 50.0))
Pair = list[ScenarioSpec]


def pair(
    maker: SceneMaker, name: str, *, clause: bool = True, other_m: float = 100.0, cars: tuple[Car, ...] = ()
) -> Pair:
    """A limit of 30 km/h from 100 m on, or of 70; other_m: where the other half's post stands; cars: its own."""

    def asked(elements: list[etree._Element]) -> None:
        if clause:
            elements.append(contrast_to_poi(SLOW, 0.0, 0.0))

    def half(name: str, limit: float, at: float, **more: object) -> ScenarioSpec:
        sign, start = speed_plate(maker.network, "road", at, limit), EgoStart("road_1", 30.0, 8.0)
        spec = maker.make(name, start, Destination("road", 200.0), ("road",), sign, horizon=600, **more)  # type: ignore[arg-type]
        return replace(spec, scenario_type="speed_limit", map_id=name)

    signed = replace(half(name, 30.0, 100.0), pair_id=name)
    contrast = half(f"{name}-c", 70.0, other_m, change=asked, cars=cars)
    return [signed, replace(contrast, pair_id=name, half=CONTRAST, map_id=signed.map_id)]


def certifier(root: Path) -> Certifier:
    return Certifier(simulation(), loader_of(root))


def prove(maker: SceneMaker, halves: Pair) -> list[Certificate]:
    prover = certifier(maker.root)
    found = [prover.prove(spec, "idm", 0, 0.0, 0.0) for spec in halves]
    assert all(c.solvable for c in found)
    return list(prover.compare(found))


def test_a_pair_that_no_one_drive_passes(maker: SceneMaker) -> None:
    halves = pair(maker, "sound")
    for row, c in zip(halves, prove(maker, halves), strict=True):
        assert (c.exclusive, c.passed_by, c.blind_equal, c.differs_s, c.brake_mps2) == (True, "", True, None, None)
        assert c.unpaired_because(row) == ""


def test_who_obeys_the_lower_limit_in_both_halves_shows_that_the_pair_asks_nothing(maker: SceneMaker) -> None:
    halves = pair(maker, "idle", clause=False)
    found = prove(maker, halves)[0]
    assert (found.exclusive, found.passed_by) == (False, "who always obeys the signed plate")
    assert found.unpaired_because(halves[0]) == "one drive passes both halves"
    only = replace(found, exclusive=True)
    assert only.unpaired_because(halves[1]) == "who always obeys the signed plate passes both halves"


def test_a_signed_half_has_to_tempt_and_to_bind_a_contrast_half_has_not(maker: SceneMaker) -> None:
    signed, contrast = halves = pair(maker, "tame")
    a, b = prove(maker, halves)
    assert (a.tempting, b.tempting) == (True, False)
    assert replace(a, tempting=False).unpaired_because(signed) == "idm keeps the rule of the signed half"
    assert replace(a, engaged=False).unpaired_because(signed) == "the rule binds nobody"
    assert replace(b, engaged=False).unpaired_because(contrast) == ""


def test_rows_that_were_proven_before_on_the_same_scenes_are_known(maker: SceneMaker) -> None:
    halves = pair(maker, "sound")
    proven = prove(maker, halves)
    again = Certifier(simulation(), loader_of(maker.root), proven)
    assert list(again.known(halves, "idm")) == proven
    signed, contrast = halves
    assert again.known([replace(signed, additional_sha256="0" * 64), contrast], "idm") == ()
    assert again.known([*halves, replace(signed, scenario_id="another")], "idm") == ()
    assert again.known(halves, "idm-s1") == ()
    for change in ({"scoring": proven[0].scoring - 1}, {"reproduced": False}):
        void = [replace(one, **change) for one in proven]  # type: ignore[arg-type]
        assert Certifier(simulation(), loader_of(maker.root), void).known(halves, "idm") == ()


def test_a_post_that_stands_elsewhere_tells_the_halves_apart(maker: SceneMaker) -> None:
    halves = pair(maker, "moved", other_m=100.5)
    found = prove(maker, halves)[0]
    assert (found.exclusive, found.blind_equal) == (True, False)
    assert found.unpaired_because(halves[0]) == "the halves differ in more than what the plates say"


def test_others_who_betray_the_half_early_and_too_late(maker: SceneMaker) -> None:
    """A car that enters beside the road's end: when there is time to stop, when only who waits has it, never."""
    early = prove(maker, pair(maker, "early", cars=(Car("bg_000", 0, 1.0, ("road",), 2, 120.0),)))[0]
    assert early.blind_equal is True
    assert early.differs_s == pytest.approx(1.0, abs=0.5)
    assert early.brake_mps2 < 6.0
    assert "who watches the others can still stop with" in early.unpaired_because(pair(maker, "early")[0])
    # Too late for who drives on, but not for who stands and watches.
    late = prove(maker, pair(maker, "late", cars=(Car("bg_000", 0, 9.0, ("road",), 2, 250.0),)))[0]
    assert late.differs_s == pytest.approx(9.0, abs=0.5)
    assert late.brake_mps2 < 6.0
    never = prove(maker, pair(maker, "never", cars=(Car("bg_000", 0, 70.0, ("road",), 2, 250.0),)))[0]
    assert (never.differs_s, never.brake_mps2) == (None, None)


def test_a_drive_with_other_answers_is_driven_again(maker: SceneMaker, monkeypatch: pytest.MonkeyPatch) -> None:
    early = pair(maker, "others", cars=(Car("bg_000", 0, 1.0, ("road",), 2, 120.0),))
    prover, halves = certifier(maker.root), pair(maker, "again")
    driven = [prover._drive("idm", spec) for spec in (early[1], halves[0])]
    ticks, answers = driven[1].result.facts.snapshots, driven[1].seen.answers  # type: ignore[union-attr]
    assert prover._first_difference(ticks, answers, halves[1], driven[0]) is not None
    driven[0].seen.answers[0] = Control(-1.0, 0.0)
    assert prover._first_difference(ticks, answers, halves[1], driven[0]) is None

    found = [prover.prove(spec, "idm", 0, 0.0, 0.0) for spec in halves]
    said: list[Control] = []

    def passes(planner: LoadedPlanner, _: ScenarioSpec) -> bool:
        driver = planner.factory()
        if isinstance(driver, Recorder):
            driver.answers = list(said)
        return isinstance(driver, AnswerReplay)

    monkeypatch.setattr(prover, "_passes", passes)
    assert prover.compare(found)[0].exclusive is True
    said.append(Control(9.0, 0.0))
    assert prover.compare(found)[0].exclusive is False


def test_braking_is_for_what_is_still_ahead(maker: SceneMaker) -> None:
    front = ego_at(maker.network, "road_1", 50.0, speed=12.0)
    tick = WorldSnapshot(0, 0.0, front, None)  # type: ignore[arg-type]
    x, y = front.front
    assert braking_before((x + 12.0, y + 1.0), tick) == pytest.approx(6.0)
    assert braking_before((x, y), tick) is None


def test_rows_that_were_not_proven_together_are_no_pair(maker: SceneMaker) -> None:
    one, two = prove(maker, pair(maker, "one")), prove(maker, pair(maker, "two"))
    prover = certifier(maker.root)
    for spec in pair(maker, "two"):
        prover.prove(spec, "idm", 0, 0.0, 0.0)
    with pytest.raises(ValueError, match="one was not proven last"):
        prover.compare([one[0], two[1]])


def test_another_process_finds_the_same_of_a_pair(maker: SceneMaker) -> None:
    halves, false = pair(maker, "good"), pair(maker, "false")
    store_scenes([*halves, *false], maker.root, maker.root)
    wrong = [replace(c, differs_s=3.0) for c in prove(maker, false)]
    write_certificates([*prove(maker, halves), *wrong], certificates_path(maker.root))
    problems = recertify([*halves, *false], maker.root, 1, lambda _: None)
    said = "it comes out differently than when it was certified: differs_s was 3.0, is None"
    assert problems == [("false", said), ("false-c", said)]
    kept = {c.scenario_id: c for c in read_certificates(certificates_path(maker.root))}
    assert [kept[row.scenario_id].reproduced for row in (*halves, *false)] == [True, True, False, False]
    assert kept["good-c"].exclusive is True


def test_a_sample_takes_both_halves(maker: SceneMaker) -> None:
    rows = [*pair(maker, "speed_limit-a"), *pair(maker, "speed_limit-b")]
    for size in (1, 2):
        drawn = draw_sample(rows, size)
        assert len(drawn) == 2 * size
        assert len({row.pair_id for row in drawn}) == size
