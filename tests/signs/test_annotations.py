"""A plate written as a SUMO point of interest and read again is the same plate."""

import math
import string
from dataclasses import fields

import pytest
from command_line import one_line
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.signs.annotations import (
    ALL_LANES,
    ROLES,
    SignInstance,
    overruled,
    sign_to_poi,
    signs_from_additional,
    sumo_angle,
)
from tsbench.signs.catalog import load_catalog
from tsbench.signs.rule_kinds import RULE_KINDS, GiveWayParams, ZoneParams

CATALOG = load_catalog()
NAMES = st.text(string.ascii_letters + string.digits + "_-.#:", min_size=1, max_size=12)
FLOATS = st.floats(-1e7, 1e7)
FIELDS = {
    "id": NAMES,
    "value": st.none() | FLOATS,
    "edge": NAMES,
    "lane": st.integers(ALL_LANES, 9),
    "position_m": st.floats(0, 1e5),
    "x": FLOATS,
    "y": FLOATS,
    "heading": st.floats(-10, 10),
    "ends": st.none(),
    "temporary": st.booleans(),
}


def _params(code: str) -> st.SearchStrategy[object]:
    kind = RULE_KINDS[CATALOG.sign(code).rule.name].params
    several = st.lists(NAMES, min_size=1, max_size=3).map(tuple)
    types = {} if kind is None else {f.name: NAMES if f.type == "str" else several for f in fields(kind)}
    return st.none() if kind is None else st.builds(kind, **types)


@st.composite
def _signs(draw: st.DrawFn) -> SignInstance:
    code, role = draw(st.sampled_from(list(CATALOG.signs))), draw(st.sampled_from(ROLES))
    params = draw(_params(code)) if role == "target" or draw(st.booleans()) else None
    return SignInstance(code=code, role=role, params=params, **{k: draw(s) for k, s in FIELDS.items()})


SIGNS = _signs()


def plate(**changes: object) -> SignInstance:
    fields: dict[str, object] = {
        "id": "target",
        "code": "3.24",
        "value": 40.0,
        "edge": "-12#3",
        "lane": ALL_LANES,
        "position_m": 12.5,
        "x": 3.0,
        "y": -4.0,
        "heading": 0.0,
        "role": "target",
        "params": ZoneParams(("-12#3", "13")),
    }
    return SignInstance(**{**fields, **changes})  # type: ignore[arg-type]


def additional(*signs: SignInstance) -> etree._Element:
    root = etree.Element("additional")
    root.extend(sign_to_poi(sign) for sign in signs)
    return root


@given(st.lists(SIGNS, max_size=4, unique_by=lambda sign: sign.id))
def test_round_trip_through_text_is_exact(signs: list[SignInstance]) -> None:
    text = etree.tostring(additional(*signs), encoding="utf-8")
    assert signs_from_additional(etree.fromstring(text), CATALOG, "scene") == tuple(signs)


def test_only_a_temporary_plate_says_so() -> None:
    keys = [{param.get("key") for param in sign_to_poi(plate(temporary=is_one))} for is_one in (False, True)]
    assert keys[1] - keys[0] == {"temporary"}


TEMPORARY = plate(temporary=True, position_m=50.0, params=ZoneParams(("a", "b")), edge="a")


@pytest.mark.parametrize(
    ("change", "is_overruled"),
    [
        ({"edge": "a", "position_m": 60.0}, True),
        ({"edge": "b", "position_m": 0.0}, True),
        # Before the temporary plate, and where its zone is over.
        ({"edge": "a", "position_m": 40.0}, False),
        ({"edge": "c"}, False),
        # A later temporary plate is obeyed as any later plate.
        ({"edge": "b", "temporary": True}, False),
    ],
)
def test_a_temporary_plate_overrules_permanent_ones_in_its_zone(change: dict[str, object], is_overruled: bool) -> None:
    other = plate(id="other", value=60.0, **change)
    assert overruled(other, [TEMPORARY, other]) is is_overruled
    assert not overruled(TEMPORARY, [TEMPORARY, other])
    assert not overruled(other, [plate(edge="a", position_m=50.0, params=ZoneParams(("a", "b")))])


def test_an_end_plate_names_the_plate_it_ends() -> None:
    end = plate(id="end", code="3.25", role="end", ends="target", params=None)
    assert signs_from_additional(additional(plate(), end), CATALOG, "scene")[1].ends == "target"


def test_points_of_interest_of_other_types_are_skipped() -> None:
    root = additional(plate())
    etree.SubElement(root, "poi", {"id": "cafe", "type": "amenity", "x": "0", "y": "0"})
    assert [sign.id for sign in signs_from_additional(root, CATALOG, "scene")] == ["target"]


@pytest.mark.parametrize(
    ("heading", "angle"),
    [(0.0, 90.0), (math.pi / 2, 0.0), (math.pi, 270.0), (-math.pi / 2, 180.0), (math.pi / 2 + 1e-18, 0.0)],
)
def test_sumo_angle_turns_clockwise_from_north(heading: float, angle: float) -> None:
    assert sumo_angle(heading) == pytest.approx(angle)


@given(st.floats(-100, 100))
def test_sumo_angle_stays_in_its_range(heading: float) -> None:
    assert 0.0 <= sumo_angle(heading) < 360.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"heading": math.nan}, "heading"),
        ({"x": math.inf}, "x"),
        ({"value": math.nan}, "value"),
        ({"lane": -2}, "lane"),
        ({"position_m": -0.1}, "position_m"),
        ({"role": "main"}, "role"),
        ({"id": ""}, "id"),
    ],
)
def test_an_impossible_plate_is_refused(change: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        plate(**change)


def broken(key: str, text: str | None) -> etree._Element:
    """A scene whose plate has one attribute or param set to a text, or removed with None."""
    root = additional(plate())
    poi = root[0]
    if key in poi.attrib:
        poi.attrib.pop(key) if text is None else poi.set(key, text)
        return root
    param = next(child for child in poi if child.get("key") == key)
    poi.remove(param) if text is None else param.set("value", text)
    return root


NUMBERS = ("x", "angle", "lane", "position_m", "heading")
NAMED = ("id", "code", "edge")


@pytest.mark.parametrize(
    ("key", "text"),
    [
        *((key, text) for key in (*NUMBERS, "role") for text in (None, "", "nan", "one\ntwo")),
        *((key, text) for key in NAMED for text in (None, "")),
    ],
)
def test_a_damaged_plate_gives_one_line_with_file_and_place(key: str, text: str | None) -> None:
    with one_line(match=r"^scene\.add\.xml: sign .*"):
        signs_from_additional(broken(key, text), CATALOG, "scene.add.xml")


def with_param(**attributes: str) -> etree._Element:
    root = additional(plate())
    etree.SubElement(root[0], "param", attributes)
    return root


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (broken("angle", "12.0"), "contradicts"),
        (additional(plate(), plate()), "twice"),
        (with_param(key="code", value="2.4"), "a param has"),
        (with_param(value="2.4"), "a param has"),
        (with_param(key="temporary", value="false"), "temporary: 'false' is not true"),
        (additional(plate(role="end", ends="gone")), "not in the scene"),
        (
            additional(plate(code="2.4", value=None, params=GiveWayParams("a b", "c", ("d",)))),
            "param 'approach' must be one name, not 'a b'",
        ),
        (additional(plate(code="3.1", value=None)), "param 'zone_edges': rule no_entry knows none"),
        (additional(plate(code="9.9")), r"^scene: sign 'target': .*no sign '9\.9'"),
    ],
)
def test_a_scene_that_contradicts_itself_is_refused(scene: etree._Element, said: str) -> None:
    with pytest.raises(InputError, match=said):
        signs_from_additional(scene, CATALOG, "scene")


@pytest.mark.parametrize(
    ("params", "said"),
    [
        ({}, "param 'zone_edges' is missing (rule speed)"),
        ({"zone_edges": " "}, "param 'zone_edges' is missing (rule speed)"),
        ({"zone_edges": "a", "approach": "b"}, "param 'approach' is none of zone_edges (rule speed)"),
    ],
)
def test_params_that_a_rule_cannot_use_are_named(params: dict[str, str], said: str) -> None:
    root = additional(plate(params=None))
    for key, value in params.items():
        etree.SubElement(root[0], "param", {"key": key, "value": value})
    with pytest.raises(InputError) as refusal:
        signs_from_additional(root, CATALOG, "scene.add.xml")
    assert str(refusal.value) == f"scene.add.xml: sign 'target': {said}"


def test_a_context_plate_without_params_binds_nobody() -> None:
    [sign] = signs_from_additional(additional(plate(role="context", params=None)), CATALOG, "scene")
    assert sign.params is None
    with pytest.raises(InputError, match=r"sign 'target' \(3\.24\): carries no ZoneParams: None"):
        sign.params_as(ZoneParams)
