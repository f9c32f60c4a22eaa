"""What driving a row proves, and certificates that are renewed by other processes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from simworld import SceneMaker, actors, loader_of, simulation, speed_plate, store_scenes

from tsbench.core.errors import InputError
from tsbench.episode.outcome import EpisodeFacts
from tsbench.make.certify.certifier import Certifier, recertify
from tsbench.make.certify.evidence import overlapping_pairs, road_users
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates, write_certificates
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import Actors


def scene(maker: SceneMaker, name: str, limit: float = 30.0, horizon: int = 600) -> ScenarioSpec:
    """A limit of `limit` km/h from 100 m on; the destination is at 200 m."""
    sign = speed_plate(maker.network, "road", 100.0, limit)
    start = EgoStart("road_1", 30.0, 8.0)
    spec = maker.make(name, start, Destination("road", 200.0), ("road",), sign, horizon=horizon)
    return replace(spec, scenario_type="speed_limit", map_id=name)


def prover(maker: SceneMaker) -> Certifier:
    return Certifier(simulation(), loader_of(maker.root))


def prove(maker: SceneMaker, spec: ScenarioSpec, asked: float = 0.0, realised: float = 0.0) -> Certificate:
    return prover(maker).prove(spec, "idm", 2, asked, realised)


def test_a_scene_that_tempts_and_can_be_solved(maker: SceneMaker) -> None:
    c = prove(maker, scene(maker, "tempts"))
    assert (c.solvable, c.expert, c.tempting, c.engaged, c.sane) == (True, "idm-e", True, True, True)
    assert (c.blind_baseline, c.blind_outcome, c.attempt, c.reproduced) == ("idm", "arrived", 2, None)
    assert 14.0 < c.expert_time_s < 40.0
    assert math.isnan(c.arrival_gap_s)


def test_who_breaks_the_rule_of_a_scene(maker: SceneMaker) -> None:
    screener = prover(maker)
    assert [screener.breaks(name, scene(maker, "tempts")) for name in ("idm", "idm-e")] == [True, False]
    # Not enough time to reach the plate, and no episode at all: nobody was seen breaking anything.
    assert not screener.breaks("idm", scene(maker, "short", horizon=5))
    gone = replace(scene(maker, "gone"), additional="scenes/nowhere.add.xml.gz")
    assert not screener.breaks("idm", gone)


def test_a_scene_that_does_not_tempt(maker: SceneMaker) -> None:
    c = prove(maker, scene(maker, "dull", limit=90.0))
    assert (c.solvable, c.tempting) == (True, False)


def test_a_scene_that_nobody_solves(maker: SceneMaker) -> None:
    c = prove(maker, scene(maker, "short", horizon=40))
    assert (c.solvable, c.expert, c.tempting, c.blind_outcome) == (False, "", True, "timeout")
    assert math.isnan(c.expert_time_s)


def test_a_scene_that_does_not_load_is_neither_solvable_nor_sane(maker: SceneMaker) -> None:
    spec = replace(scene(maker, "changed"), additional_sha256="0" * 64)
    c = prove(maker, spec)
    assert (c.solvable, c.sane) == (False, False)
    assert "SHA-256 differs" in c.error


@pytest.mark.parametrize(("asked", "realised", "sane"), [(0.0, 0.0, True), (10.0, 10.0, False), (10.0, 7.0, False)])
def test_traffic_that_is_asked_for_has_to_be_there(
    maker: SceneMaker, asked: float, realised: float, sane: bool
) -> None:
    """Nobody else is on this road, whatever its rehearsal said."""
    assert prove(maker, scene(maker, "empty"), asked, realised).sane is sane


def test_density_within_a_quarter(maker: SceneMaker) -> None:
    c = replace(prove(maker, scene(maker, "dense")), asked_density=10.0, road_users=3)
    assert [replace(c, realised_density=d).sane for d in (7.4, 7.6, 12.4, 12.6)] == [False, True, True, False]
    assert not replace(c, realised_density=10.0, overlaps=1).sane


class _Shot:
    def __init__(self, others: Actors) -> None:
        self.actors = others


class _Facts:
    def __init__(self, *ticks: Actors) -> None:
        self.snapshots = [_Shot(t) for t in ticks]


def facts(*ticks: Actors) -> EpisodeFacts:
    return _Facts(*ticks)  # type: ignore[return-value]


def test_bodies_that_overlap_deeply_are_counted_once() -> None:
    apart = actors((0.0, 0.0, 0.0, 4.5, 1.8), (4.4, 0.0, 0.0, 4.5, 1.8))  # 0.1 m into each other
    deep = actors((0.0, 0.0, 0.0, 4.5, 1.8), (3.0, 0.5, 0.3, 4.5, 1.8), (20.0, 0.0, 0.0, 4.5, 1.8))
    assert overlapping_pairs(facts(*[apart] * 6)) == 0
    assert overlapping_pairs(facts(*[deep] * 6)) == 1
    assert overlapping_pairs(facts(actors())) == 0
    assert road_users(facts(deep)) == 3


def test_the_same_row_gives_the_same_certificate(maker: SceneMaker) -> None:
    spec = scene(maker, "again")
    first = prove(maker, spec)
    assert prove(maker, spec).digest == first.digest
    assert prove(maker, replace(spec, horizon=40)).digest != first.digest
    (again,) = prover(maker).again([(spec, first)])
    assert again == replace(first, reproduced=True, arrival_gap_s=again.arrival_gap_s)
    # Another scoring, or another processor, may have made it, and it holds; what it found has to be found again.
    made = [{"scoring": 1, "digest": "0"}, {"expert_time_s": first.expert_time_s + 0.1}, {"arrival_gap_s": 2.0}]
    renewed = [prover(maker).again([(spec, replace(first, **fields))]) for fields in made]
    assert [c.reproduced for (c,) in renewed] == [True, False, False]
    other = replace(first, blind_outcome="timeout", engaged=False)
    assert first.differences(other) == ["blind_outcome was 'arrived', is 'timeout'", "engaged was True, is False"]


def test_other_processes_renew_certificates(maker: SceneMaker) -> None:
    good, bad, false = (scene(maker, n) for n in ("good", "bad", "false"))
    bad = scene(maker, "bad", horizon=40)
    path = certificates_path(maker.root)
    kept = [prove(maker, good), prove(maker, bad), replace(prove(maker, false), overlaps=1)]
    write_certificates(kept, path)
    told: list[int] = []
    store_scenes([good, bad, false], maker.root, maker.root)
    problems = recertify([good, bad, false], maker.root, 2, told.append)
    assert problems == [
        ("bad", "no expert solves it"),
        ("false", "it comes out differently than when it was certified: overlaps was 1, is 0"),
    ]
    assert told == [1, 2, 3]
    assert [(c.scenario_id, c.reproduced) for c in read_certificates(path)] == [
        ("bad", True), ("false", False), ("good", True),
    ]  # fmt: skip
    part = maker.root / "build" / "certify" / "speed_limit" / "good.json"
    written = part.stat().st_mtime_ns
    assert recertify([good], maker.root, 1, told.append) == []
    assert part.stat().st_mtime_ns == written  # read, not driven


def test_a_row_without_certificate_is_one_line(maker: SceneMaker) -> None:
    write_certificates([], certificates_path(maker.root))
    with pytest.raises(InputError, match=r"certificates.parquet: no certificate for lone"):
        recertify([scene(maker, "lone")], maker.root, 1, lambda _: None)
