"""How the four types are arranged on maps made by hand, and whole sites built from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pool_builders import Networks, built_site, corridor, crossroads, recipe_of, scene_task, signed_half, two_way
from simworld import LIMIT, cross_plain, loader_of, road_plain
from test_route_scenes import TYPES, ways

from tsbench.geometry.elementary import wrap
from tsbench.geometry.polyline import Polyline
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode, split_edge
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.junction_priority import gives_way, link
from tsbench.make.placements.placement import Arrangement, SceneTask, UnluckyDrawError
from tsbench.make.scenes import map_scenarios as site_module
from tsbench.make.scenes.map_scenarios import MapScenarios
from tsbench.make.scenes.recipe import Variant
from tsbench.make.scenes.verify import lint_scene
from tsbench.roads.lane_graph import LaneGraph
from tsbench.rules.monitors import make_monitors
from tsbench.scenarios.certificates import Certificate
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import overruled
from tsbench.signs.catalog import load_catalog
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.world import EGO_LENGTH_M

LAYOUTS = range(6)
LoneYield = Callable[..., MapScenarios]
MAPS: dict[str, tuple[PoolRow, PlainNet]] = {
    "yield": (crossroads(), cross_plain()),
    "speed_limit": two_way(length=300.0),
    "detour_right": (corridor(speed=LIMIT), road_plain()),
    "no_turn_left": ways(*TYPES["no_turn_left"]),
    "limit_and_yield": (crossroads(), cross_plain()),
    "limit_and_detour": (corridor(speed=LIMIT), road_plain()),
    "limit_in_zone": two_way("tertiary", length=300.0),
    "stop_and_no_turn": ways(*TYPES["no_turn_left"]),
    "limit_and_direction": ways(*TYPES["direction_left"]),
    "limit_and_stop": (crossroads(), cross_plain()),
    "limit_and_crosswalk": two_way(length=240.0),
    "limit_and_bus_lane": two_way(speed=LIMIT, length=250.0),
    "temporary_limit": two_way(length=300.0),
    "yield_and_direction": ways("r_l", "X", longer_m=60.0),
}


def place(networks: Networks, type_id: str, variant: Variant, seed: int = 1) -> Arrangement:
    return signed_half(scene_task(MAPS[type_id][0], networks[type_id], recipe_of(type_id), variant, seed))


VARIANT = st.builds(
    Variant, st.just(1), st.sampled_from([90.0, 120.0]), st.sampled_from([0.0, 4.0]),
    st.sampled_from([3.61, 7.75, 11.05]), st.integers(0, 2), st.sampled_from(LAYOUTS),
)  # fmt: skip


@settings(deadline=None, max_examples=30)
@given(st.sampled_from(sorted(MAPS)), VARIANT, st.integers(0, 1000))
def test_what_holds_for_every_scene(networks: Networks, type_id: str, variant: Variant, seed: int) -> None:
    a, network = place(networks, type_id, variant, seed), networks[type_id]
    graph, start = LaneGraph(network), network.lane(a.start.lane)
    kind = load_catalog().type(type_id)
    # Exactly one plate is what the scenario is about; navigation leads to the destination, whatever it says.
    target = next(s for s in a.signs if s.id == a.targets[0])
    assert (target.code in kind.codes, target.role) == (True, "target")
    assert a.route_hint == graph.route(start.edge, a.destination.edge)
    assert graph.path(a.route_hint, start.index, a.start.s, a.destination) is not None
    assert EGO_LENGTH_M / 2 <= a.start.s <= start.line.length - EGO_LENGTH_M / 2
    assert 0.0 <= a.start.speed <= start.speed + 1e-9
    assert 0.0 < a.destination.s < network.edge_lanes(a.destination.edge)[0].line.length
    assert a.route_length > 0.0
    for sign in a.signs:
        lane = network.edge_lanes(sign.edge)[max(sign.lane, 0)]
        s, d = lane.line.project(sign.x, sign.y)
        assert s == pytest.approx(sign.position_m, abs=0.01)
        assert wrap(sign.heading - lane.line.heading_at(s)) == pytest.approx(0.0, abs=1e-6)
        if sign.lane < 0:
            assert d == pytest.approx(-lane.width / 2 - 1.2, abs=0.01)
    # The same draw gives the same scene.
    assert place(networks, type_id, variant, seed).signs == a.signs
    assert place(networks, type_id, variant, seed).start == a.start


BENT = PlainEdge("e", "a", "b", 2, LIMIT, 5, ((0.0, 0.0), (60.0, 0.0), (110.0, 30.0), (160.0, 30.0)))


@given(st.lists(st.floats(5.0, 160.0), min_size=1, max_size=3, unique=True))
def test_a_cut_edge_is_the_same_road(cuts: list[float]) -> None:
    cuts = sorted(c for k, c in enumerate(sorted(cuts)) if k == 0 or c - sorted(cuts)[k - 1] > 1.0)
    nodes = (PlainNode("a", 0.0, 0.0), PlainNode("b", 160.0, 30.0))
    other = PlainEdge("back", "b", "a", 1, LIMIT, 5, ((160.0, 30.0), (0.0, 0.0)))
    net, parts = split_edge(PlainNet(nodes, (BENT, other), ()), "e", cuts)
    whole = Polyline(BENT.shape)
    assert parts == tuple(f"e.{k}" for k in range(len(cuts) + 1))
    by_id = {e.id: e for e in net.edges}
    assert "e" not in by_id
    assert by_id["back"] == other
    chain = [by_id[p] for p in parts]
    assert (chain[0].source, chain[-1].target) == ("a", "b")
    assert all(x.target == y.source for x, y in pairwise(chain))
    places = {n.id: (n.x, n.y) for n in net.nodes}
    for part, (begin, end) in zip(chain, pairwise([0.0, *cuts, whole.length]), strict=True):
        line = Polyline(part.shape)
        assert line.length == pytest.approx(end - begin)
        assert part.shape[0] == pytest.approx(whole.point_at(begin))
        assert part.shape[-1] == pytest.approx(whole.point_at(end))
        assert places[part.source] == pytest.approx(part.shape[0])
        assert (part.num_lanes, part.speed, part.priority) == (2, LIMIT, 5)
    links = {(c.source, c.target, c.from_lane, c.to_lane) for c in net.connections}
    assert links == {(p, q, i, i) for p, q in pairwise(parts) for i in range(2)}


def test_a_cut_road_keeps_its_lanes_in_line(networks: Networks) -> None:
    network = networks["speed_limit"]
    for part, following in (("road.0", "road.1"), ("road.1", "road.2")):
        for a, b in zip(network.edge_lanes(part), network.edge_lanes(following), strict=True):
            assert a.line.points[-1] == pytest.approx(b.line.points[0], abs=0.2)
            assert [c.to_lane for c in network.outgoing[a.index]] == [b.index]
    assert sum(network.edges[f"road.{k}"].length for k in range(3)) == pytest.approx(300.0, abs=0.5)


class Recorder:
    """Proves nothing: every row is called solved and tempting; `asked` holds what the builder measured."""

    expert = "idm-e"

    def __init__(
        self,
        verdicts: Callable[[ScenarioSpec, int], tuple[bool, bool]] = lambda *_: (True, True),
        broken: Callable[[int], bool] = lambda _: True,
    ) -> None:
        self.verdicts, self.broken = verdicts, broken
        self.attempt = -1

    def prove(
        self, spec: ScenarioSpec, blind_baseline: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        solved, tempting = self.verdicts(spec, attempt)
        self.attempt = attempt
        return Certificate(
            spec.scenario_id, spec.scenario_type, spec.split, attempt, "idm-e" if solved else "", 1.0, blind_baseline,
            "arrived", tempting, True, asked, realised, 5, 0, 0.0, "", spec.additional_sha256, "", "", None,
        )  # fmt: skip

    def known(self, rows: Sequence[ScenarioSpec], blind_baseline: str) -> tuple[Certificate, ...]:
        del rows, blind_baseline
        return ()

    def compare(self, proven: Sequence[Certificate]) -> tuple[Certificate, ...]:
        return tuple(replace(c, exclusive=True, blind_equal=True) for c in proven)

    def breaks(self, planner: str, spec: ScenarioSpec) -> bool:
        assert (planner, spec.scenario_type) == ("reckless", "yield")
        return self.broken(self.attempt)


def build(
    type_id: str,
    root: Path,
    numbers: tuple[int, ...],
    prover: Recorder | None = None,
    violating_baseline: str = "",
    paired: bool | None = None,
) -> MapScenarios:
    """A site of some of its variants, from the hand-made crop. paired: None = as the recipe says."""
    recipe = recipe_of(type_id)
    recipe = replace(recipe, violating_baseline=violating_baseline, paired=recipe.paired if paired is None else paired)
    return built_site(
        recipe, root, MAPS[type_id], lambda variants: [variants[k] for k in numbers], prover or Recorder()
    )


@pytest.fixture
def lone_yield(tmp_path: Path) -> LoneYield:
    """Builds variants of `yield` without contrast halves, each time below a folder of its own name."""

    def built(folder: str, numbers: tuple[int, ...], prover: Recorder | None = None, **more: str) -> MapScenarios:
        return build("yield", tmp_path / folder, numbers, prover, paired=False, **more)

    return built


# Without the approaches that they leave empty the roads made by hand carry no traffic.
@pytest.mark.parametrize("type_id", sorted(set(MAPS) - {"stop_and_no_turn", "yield_and_direction"}))
def test_a_site_is_sound_dense_as_asked_and_the_same_again(type_id: str, tmp_path: Path) -> None:
    one = build(type_id, tmp_path / "one", (0, 1))
    assert one.reason == ""
    recipe = recipe_of(type_id)
    halves = ["signed", "contrast"] * (2 if recipe.last else 1) if recipe.paired else ["signed"]
    assert [(r.variant, r.half) for r in one.rows] == [(k, half) for k in (0, 1) for half in halves]
    loader = loader_of(tmp_path / "one")
    for row, certificate in zip(one.rows, one.certificates, strict=True):
        density = certificate.realised_density
        scene, roads = loader.load(row)
        assert list(lint_scene(scene, roads.graph)) == []
        assert (row.pair_type, row.split, row.map_id) == (type_id, "test", MAPS[type_id][0].map_id)
        assert row.initial_speed == scene.start.speed
        assert (scene.convoy is not None) == type_id.endswith(("yield", "stop"))
        assert (len(scene.obstacles) > 0) == ("detour" in type_id)
        if row.density:
            assert density == pytest.approx(row.density / 0.3, rel=0.25)
        else:
            assert density == 0.0
        assert math.isfinite(row.route_length)
    folder = tmp_path / "one" / "scenes" / type_id
    files = [f"v{k}{end}.add.xml.gz" for k in (0, 1) for end in ("", "c", "b", "bc")[: len(halves)]]
    # Who has priority stands in the network.
    nets = ["contrast.net.xml.gz", "net.net.xml.gz"] if scene.convoy else ["net.net.xml.gz"]
    assert sorted(p.name for p in folder.rglob("*.gz")) == sorted([*nets, *files])
    two = build(type_id, tmp_path / "two", (0, 1))
    assert two == one  # the rows hold the hashes of the files


WAITING = {"needless_stop", "needless_yield"}
SQUARES = {
    # Codes of the first sign in its own and its contrast half, those of the last, clauses that go with each.
    "limit_and_yield": (("3.24", "3.24"), ("2.4", "2.1"), {"needless_slow"}, WAITING),
    "limit_in_zone": (("5.31", "5.31"), ("3.24", "3.24"), {"needless_slow"}, {"needless_slow"}),
    "stop_and_no_turn": (("2.5", "2.4"), ("3.18.2", "4.1.6"), WAITING, {"needless_detour"}),
    "limit_and_direction": (("3.24", "3.24"), ("4.1.3", "3.18.2"), {"needless_slow"}, {"needless_detour"}),
    "limit_and_stop": (("3.24", "3.24"), ("2.5", "2.1"), {"needless_slow"}, WAITING),
    "limit_and_crosswalk": (("3.24", "3.24"), ("5.19", "3.24"), {"needless_slow"}, WAITING),
    "limit_and_bus_lane": (("3.24", "3.24"), ("5.14.1", "5.14.1"), {"needless_slow"}, {"needless_detour"}),
    "yield_and_direction": (("2.4", "2.1"), ("4.1.3", "3.18.2"), WAITING, {"needless_detour"}),
}


@pytest.mark.parametrize("type_id", SQUARES)
def test_a_square_is_two_pairs_that_differ_in_one_sign_each(type_id: str, tmp_path: Path) -> None:
    site, (first, last, of_first, of_last) = build(type_id, tmp_path, (0,)), SQUARES[type_id]
    square = f"{type_id}-{MAPS[type_id][0].map_id}-v0"
    assert [r.scenario_id for r in site.rows] == [square, f"{square}-c", f"{square}b", f"{square}b-c"]
    assert [r.pair_id for r in site.rows] == [square, square, f"{square}b", f"{square}b"]
    assert {r.pair_name for r in site.rows} == {square}
    loader = loader_of(tmp_path)
    scenes = [loader.load(row)[0] for row in site.rows]
    firsts, lasts = ([s.target_signs[k] for s in scenes] for k in (0, 1))
    assert [p.code for p in firsts] == [first[k % 2] for k in range(4)]
    assert [p.code for p in lasts] == [last[k // 2] for k in range(4)]
    assert firsts[0] == firsts[2] != firsts[1] == firsts[3]
    assert lasts[0] == lasts[1] != lasts[2] == lasts[3]
    for plates, exchanged in ((firsts, [False, True] * 2), (lasts, [False, False, True, True])):
        if plates[0].value is not None:
            assert [p.posted > plates[0].posted for p in plates] == exchanged
    assert len({(s.start, s.destination, s.convoy) for s in scenes}) == 1
    clauses = [{(c.name, c.sign) for c in s.contrast} for s in scenes]
    mine, theirs = ({(name, p[0].id) for name in names} for names, p in ((of_first, firsts), (of_last, lasts)))
    assert clauses == [set(), mine, theirs, mine | theirs]
    posts = [{(p.edge, p.position_m) for p in s.signs} for s in scenes]
    assert posts[1:] == posts[:-1]


# Of each row which of the two plates is temporary, which posts the higher value, and the limits that bind between the
# plates and behind the second: low or high.
TEMPORARY_LIMIT = [(0, 1, "LL"), (0, 0, "HH"), (1, 1, "LH"), (1, 0, "HL")]


def test_the_temporary_one_of_two_limits_rules(tmp_path: Path) -> None:
    site = build("temporary_limit", tmp_path, (0,))
    scenes = [loader_of(tmp_path).load(row)[0] for row in site.rows]
    assert len({(s.start, s.destination, frozenset((p.edge, p.position_m) for p in s.signs)) for s in scenes}) == 1
    assert len({frozenset(p.posted for p in s.target_signs) for s in scenes}) == 1
    for scene, (temporary, higher, limits) in zip(scenes, TEMPORARY_LIMIT, strict=True):
        plates, number = scene.target_signs, scene.targets.index
        assert plates[1 - temporary].temporary < plates[temporary].temporary
        assert plates[1 - higher].posted < plates[higher].posted
        # No other plate tells how far a limit goes, and each clause is about the plate where its stretch begins.
        assert len(scene.signs) == 2
        assert {c.name for c in scene.contrast} <= {"needless_slow"}
        assert [number(c.sign) for c in scene.contrast] == [k for k, limit in enumerate(limits) if limit == "H"]
        assert [overruled(plate, plates) for plate in plates] == [False, temporary == 0]
        monitors = make_monitors(scene)
        assert [type(m).__name__ for m in monitors.targets] == ["Speed", "Speed"]


def test_a_stop_is_made_for_where_no_vehicle_comes(networks: Networks) -> None:
    network = networks["stop_and_no_turn"]
    a = place(networks, "stop_and_no_turn", Variant(1, 90.0, 4.0, 7.75, 0, 0))
    stop, ban = (next(p for p in a.signs if p.id == target) for target in a.targets)
    assert (stop.code, ban.code) == ("2.5", "3.18.2")
    assert stop.position_m == ban.position_m - 3.0
    # The crossing road goes first, and is empty.
    into = {edge.id for edge in network.edges.values() if edge.target == "b"}
    assert into <= a.closed_edges
    states = {c.state for e in ("ab", "qb") for lane in network.edge_lanes(e) for c in network.outgoing[lane.index]}
    assert states == {"m"}
    others = {p.edge: p.code for p in a.signs if p not in (stop, ban)}
    assert others == {"qb": "2.4", "pb": "2.1", "tb": "2.1"}


@pytest.mark.parametrize("shape", ["T", "X"])
def test_a_convoy_meets_the_ego_on_either_way(shape: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    type_id = "yield_and_direction"
    monkeypatch.setitem(MAPS, type_id, ways("r_l", shape, longer_m=60.0))
    site = build(type_id, tmp_path, (0,))
    for row, waits in zip(site.rows, (True, False, True, False), strict=True):
        scene, roads = loader_of(tmp_path).load(row)
        assert scene.convoy is not None
        lead = link(roads.network, "qb_0", "bp")
        for exit_ in ("bp", "bq"):
            own = link(roads.network, scene.start.lane, exit_)
            assert (gives_way(own, lead), gives_way(lead, own)) == (waits, not waits)
        plates = {p.edge: p.code for p in scene.signs if p.code in ("2.1", "2.4")}
        mine, across = ("2.4", "2.1") if waits else ("2.1", "2.4")
        opposite = ("tb",) * (shape == "X")
        assert plates == {"ab": mine, "pb": across, "qb": across} | dict.fromkeys(opposite, mine)
        assert scene.target_signs[0].params_as(GiveWayParams).main_in == (("pb", "qb") if waits else opposite)


def test_an_unfit_map_is_a_reason_not_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MAPS, "speed_limit", two_way(length=100.0))
    site = build("speed_limit", tmp_path, (0,))
    assert site.rows == ()
    assert site.reason == "the corridor is 100 m long"
    assert not list(tmp_path.rglob("*.gz"))


def test_a_variant_is_drawn_anew_until_it_is_solved(tmp_path: Path, lone_yield: LoneYield) -> None:
    site = lone_yield("kept", (0, 1), Recorder(lambda spec, k: (spec.variant == 0 or k == 2, True)))
    assert [c.attempt for c in site.certificates] == [0, 2]
    # The files are those of the draw that was kept, and another draw is another scene.
    loader = loader_of(tmp_path / "kept")
    for row, certificate in zip(site.rows, site.certificates, strict=True):
        loader.load(row)
        assert certificate.digest == row.additional_sha256
    first = lone_yield("first", (0, 1))
    assert first.rows[0] == site.rows[0]
    assert first.rows[1].additional_sha256 != site.rows[1].additional_sha256
    assert first.rows[1].seed != site.rows[1].seed


def test_a_row_of_a_known_scene_is_not_proven_again(lone_yield: LoneYield, monkeypatch: pytest.MonkeyPatch) -> None:
    before = lone_yield("before", (0, 1), Recorder(lambda spec, k: (spec.variant == 0 or k == 2, True)))
    known, again = {c.digest: c for c in before.certificates}, Recorder(lambda *_: (False, True))
    monkeypatch.setattr(
        again, "known", lambda rows, _: tuple(known[r.additional_sha256] for r in rows if r.additional_sha256 in known)
    )
    after = lone_yield("after", (0, 1), again)
    assert (after.rows, after.certificates) == (before.rows, before.certificates)
    # Two draws of the second variant are not those that were kept.
    assert again.attempt == 1


def test_a_map_that_no_expert_solves_is_unfit(lone_yield: LoneYield) -> None:
    site = lone_yield("unsolved", (0, 1), Recorder(lambda spec, _: (spec.variant == 0, True)))
    assert site.rows == ()
    assert site.reason == "variant 1, 4 draws, at last: no expert solves it"


def test_a_map_without_places_is_unfit_before_it_is_driven(
    lone_yield: LoneYield, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = type(placement_of(recipe_of("yield")))
    placed = kind.place

    def full(self: Any, there: SceneTask) -> Arrangement:
        if there.variant.number == 1:
            raise UnluckyDrawError("no place")
        return placed(self, there)

    monkeypatch.setattr(kind, "place", full)
    never = Recorder(lambda *_: pytest.fail("a variant was driven"))
    assert lone_yield("full", (0, 1), never).reason == "variant 1, 4 draws, at last: no place"


def test_one_of_ten_need_not_tempt(tmp_path: Path, lone_yield: LoneYield, monkeypatch: pytest.MonkeyPatch) -> None:
    # Of the two that are built here one is half.
    monkeypatch.setattr(site_module, "UNTEMPTING_MOST", 0.5)
    site = lone_yield("half", (0, 1), Recorder(lambda spec, k: (k > 0, spec.variant == 0)))
    assert [(c.attempt, c.tempting) for c in site.certificates] == [(1, True), (1, False)]
    loader_of(tmp_path / "half").load(site.rows[1])
    dull = lone_yield("dull", (0, 1), Recorder(lambda *_: (True, False)))
    assert dull.reason == "2 variants do not tempt idm"


def test_a_draw_whose_violating_baseline_keeps_the_rule_is_drawn_anew(lone_yield: LoneYield) -> None:
    late = Recorder(broken=lambda attempt: attempt == 2)
    site = lone_yield("late", (0,), late, violating_baseline="reckless")
    assert [c.attempt for c in site.certificates] == [2]
    # Where none of the draws shows it, the first that is solved and tempts is as good as any.
    never = Recorder(lambda _, k: (True, k > 0), broken=lambda _: False)
    site = lone_yield("never", (0,), never, violating_baseline="reckless")
    assert [(c.attempt, c.tempting) for c in site.certificates] == [(1, True)]
