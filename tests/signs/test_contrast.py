"""What a contrast scene asks is written and read without loss, and what it cannot mean is said in one line."""

from __future__ import annotations

import string
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.signs.annotations import ALL_LANES, SignInstance, sign_to_poi, signs_from_additional
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import (
    CLAUSES,
    ContrastClause,
    PassageParams,
    SlowZoneParams,
    WayParams,
    contrast_from_additional,
    contrast_to_poi,
)
from tsbench.signs.rule_kinds import NEEDLESS

NAME = st.text(string.ascii_letters + string.digits + "_-.#:", min_size=1, max_size=9)
NAMES = st.lists(NAME, max_size=3).map(tuple)
SOME = st.lists(NAME, min_size=1, max_size=3).map(tuple)
PARAMS = {
    PassageParams: st.builds(PassageParams, NAME, NAME, NAMES, NAMES.filter(lambda n: len(n) < 2)),
    SlowZoneParams: st.builds(
        SlowZoneParams, SOME, st.floats(0.0, 50.0), st.floats(50.1, 900.0), st.floats(0.1, 200.0)
    ),
    WayParams: st.builds(WayParams, NAME, SOME, NAMES) | st.builds(WayParams, NAME, NAMES, SOME),
}
SETS = st.fixed_dictionaries({}, optional={name: PARAMS[kind] for name, kind in CLAUSES.items()}).map(
    lambda chosen: tuple(ContrastClause(name, params) for name, params in chosen.items())
)


def additional(*clauses: ContrastClause) -> etree._Element:
    root = etree.Element("additional")
    root.extend(contrast_to_poi(clause, 1.5, -2.5) for clause in clauses)
    return root


@given(SETS)
def test_round_trip_through_text_is_exact(clauses: tuple[ContrastClause, ...]) -> None:
    text = etree.tostring(additional(*clauses), encoding="utf-8")
    assert contrast_from_additional(etree.fromstring(text)) == clauses


def test_the_clauses_are_those_of_the_rule() -> None:
    assert list(CLAUSES) == NEEDLESS.clauses.split()


def _refusal(name: str, params: dict[str, str]) -> str:
    root = etree.Element("additional")
    poi = etree.SubElement(root, "poi", {"id": name, "type": "contrast"})
    for key, value in params.items():
        etree.SubElement(poi, "param", {"key": key, "value": value})
    with pytest.raises(InputError) as refusal:
        contrast_from_additional(root, "scene.add.xml")
    return str(refusal.value)


PASSAGE = {"approach": "a", "exit": "b"}
ZONE = {"zone_edges": "a b", "start_m": "1", "end_m": "61", "limit_kmh": "40"}


@pytest.mark.parametrize(
    ("name", "params", "said"),
    [
        ("needless_walk", {}, "is none of needless_stop, needless_yield, needless_slow, needless_detour"),
        ("needless_stop", {"exit": "b"}, "param 'approach' is missing"),
        ("needless_stop", {**PASSAGE, "main_in": " "}, "param 'main_in' is missing"),
        ("needless_yield", {**PASSAGE, "exit": "b c"}, "param 'exit' must be one name, not 'b c'"),
        ("needless_yield", {**PASSAGE, "crossing": "c d"}, "param 'crossing' must be one name at most, not 'c d'"),
        ("needless_yield", {**PASSAGE, "lane": "c"}, "param 'lane' is none of approach, exit, main_in, crossing"),
        ("needless_slow", {**ZONE, "end_m": "1"}, "params 'start_m' and 'end_m': no zone from 1.0 to 1.0"),
        ("needless_slow", {**ZONE, "start_m": "-0.1"}, "params 'start_m' and 'end_m': no zone from -0.1 to 61.0"),
        ("needless_slow", {**ZONE, "end_m": "inf"}, "param 'end_m': inf is not a finite number"),
        ("needless_slow", {**ZONE, "end_m": "far"}, "could not convert string to float: 'far'"),
        ("needless_slow", {**ZONE, "limit_kmh": "0"}, "param 'limit_kmh': 0.0 is no speed"),
        ("needless_detour", {"approach": "a"}, "params 'exits' and 'lanes': both are missing"),
    ],
)
def test_a_clause_that_means_nothing_is_refused(name: str, params: dict[str, str], said: str) -> None:
    assert _refusal(name, params) == f"scene.add.xml: contrast clause {name!r}: {said}"


def test_a_clause_twice_is_refused() -> None:
    clause = ContrastClause("needless_detour", WayParams("a", ("b",)))
    with pytest.raises(InputError, match=r"^scene: contrast clause 'needless_detour': occurs twice$"):
        contrast_from_additional(additional(clause, clause), "scene")


def test_a_clause_carries_its_own_params() -> None:
    with pytest.raises(ValueError, match=r"^contrast clause 'needless_slow': carries WayParams\("):
        ContrastClause("needless_slow", WayParams("a", ("b",)))
    with pytest.raises(ValueError, match=r"^contrast clause 'needless' is none of needless_stop"):
        ContrastClause("needless", WayParams("a", ("b",)))


def test_every_field_is_a_name_of_something_or_a_number() -> None:
    for kind in CLAUSES.values():
        assert {f.type for f in fields(kind) if not f.metadata} <= {"float"}


def test_the_target_of_a_contrast_scene_may_bind_nobody() -> None:
    root = additional()
    root.append(sign_to_poi(SignInstance("s", "3.24", 40.0, "a", ALL_LANES, 1.0, 2.0, 3.0, 0.0, "target")))
    with pytest.raises(InputError, match="param 'zone_edges' is missing"):
        signs_from_additional(root, load_catalog(), "scene")
    root.append(contrast_to_poi(ContrastClause("needless_slow", SlowZoneParams(("a",), 0.0, 60.0, 40.0)), 0, 0))
    [sign] = signs_from_additional(root, load_catalog(), "scene")
    assert sign.params is None
