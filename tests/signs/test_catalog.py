"""The catalogue says what the specification says, and refuses what is malformed in one line."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from tsbench.errors import InputError
from tsbench.signs.catalog import Catalog, load_catalog

Edit = Callable[[str, str, str], Path]

# spec/signs.md, the table: type, codes, end codes, group, family, in the order of the rows.
TABLE = """
main_road 2.1 - priority junction
secondary_road 2.3.1,2.3.2,2.3.3 - priority junction
yield 2.4 - priority junction
stop 2.5 - priority junction
roundabout 4.3 - priority roundabout
crosswalk 5.19 - priority corridor
speed_limit 3.24 3.25 speed corridor
min_speed 4.6 - speed corridor
residential_zone 5.21 5.22 speed corridor
zone_speed_limit 5.31 5.32 speed corridor
blocked_road 3.2 - obstacles junction
detour_right 4.2.1 - obstacles corridor
detour_left 4.2.2 - obstacles corridor
detour_either 4.2.3 - obstacles corridor
bus_lane 5.14.1 - obstacles corridor
bike_lane 5.14.2 - obstacles corridor
bus_lane_road 5.11.1 - obstacles corridor
bike_lane_road 5.11.2 - obstacles corridor
no_entry 3.1 - routing dual_path
no_turn_right 3.18.1 - routing dual_path
no_turn_left 3.18.2 - routing dual_path
direction_straight 4.1.1 - routing dual_path
direction_right 4.1.2 - routing dual_path
direction_left 4.1.3 - routing dual_path
direction_straight_right 4.1.4 - routing dual_path
direction_straight_left 4.1.5 - routing dual_path
direction_left_right 4.1.6 - routing dual_path
one_way_right 5.7.1 - routing dual_path
one_way_left 5.7.2 - routing dual_path
"""

# Of every rule: how far beside its road the ego still drives along it.
ROAD = {"beside_road_widths": 2}
GIVE_WAY = {
    "engage_distance_m": 30,
    "priority_distance_m": 60,
    "gap_s": 4,
    "min_foe_speed_mps": 2,
    "post_clear_s": 1,
    "least_overlap_m": 0.5,
    **ROAD,
}
GIVE_WAY_CLAUSES = ["entered_while_blocked", "encroached", "contact"]
DETOUR = {"engage_distance_m": 30, **ROAD}
DETOUR_CLAUSES = ["wrong_side", "contact", "off_carriageway"]
TURN = {"straight_deg": 35, "u_turn_deg": 145, **ROAD}

# spec/rules.md: thresholds and clauses by sign.
RULES: dict[str, tuple[str, dict[str, float], list[str]]] = {
    **dict.fromkeys(("2.1", "2.3.1", "2.3.2", "2.3.3", "2.4"), ("give_way", GIVE_WAY, GIVE_WAY_CLAUSES)),
    "2.5": (
        "stop",
        {**GIVE_WAY, "stop_within_m": 5, "stop_speed_mps": 0.2},
        ["no_full_stop", *GIVE_WAY_CLAUSES],
    ),
    "4.3": ("roundabout", {**GIVE_WAY, "wrong_way_m": 5}, ["wrong_direction", *GIVE_WAY_CLAUSES]),
    "5.19": (
        "crosswalk",
        {
            "engage_distance_m": 30,
            "kerb_distance_m": 2,
            "clearance_m": 1,
            "moving_mps": 0.1,
            "walks_along_cos": 0.5,
            "sweeps_across_sin": 0.3,
            **ROAD,
        },
        ["did_not_yield", "contact"],
    ),
    **{
        code: ("speed", {"tolerance_kmh": 1, **ROAD}, ["over_limit"])
        for code in ("3.24", "3.25", "5.21", "5.22", "5.31", "5.32")
    },
    "4.6": (
        "min_speed",
        {
            "tolerance_kmh": 2,
            "settle_distance_m": 50,
            "duration_s": 1,
            "leader_min_m": 15,
            "leader_margin_m": 15,
            "leader_divisor_mps2": 8,
            **ROAD,
        },
        ["under_minimum"],
    ),
    **dict.fromkeys(("4.2.1", "4.2.2", "4.2.3"), ("detour", DETOUR, DETOUR_CLAUSES)),
    "3.2": (
        "closed_road",
        {
            "engage_distance_m": 30,
            "past_line_m": 0.3,
            "held_speed_mps": 0.5,
            "held_s": 3,
            "held_within_m": 12,
            **ROAD,
        },
        ["entered_closed_road"],
    ),
    **{
        code: (
            "reserved_lane",
            {"engage_distance_m": 30, "duration_s": 0.5, **ROAD},
            ["in_reserved_lane", "contact"],
        )
        for code in ("5.14.1", "5.14.2", "5.11.1", "5.11.2")
    },
    "3.1": ("no_entry", {"past_line_m": 0.3, "engage_distance_m": 30, **ROAD}, ["entered"]),
    **{
        code: ("manoeuvre", TURN, ["prohibited_manoeuvre"])
        for code in ("3.18.1", "3.18.2", "4.1.1", "4.1.2", "4.1.3", "4.1.4", "4.1.5", "4.1.6")
    },
    **{
        code: ("one_way_exit", TURN | {"against_deg": 90}, ["wrong_carriageway", "prohibited_manoeuvre"])
        for code in ("5.7.1", "5.7.2")
    },
}

# spec/rules.md and the table's slots: what each sign allows, and the dual-path slots that tempt.
ALLOWED = {
    "3.18.1": ("straight left u_turn", "r_s r_l"),
    "3.18.2": ("straight right u_turn", "l_s l_r"),
    "4.1.1": ("straight", "l_s r_s"),
    "4.1.2": ("right", "s_r l_r"),
    "4.1.3": ("left u_turn", "s_l r_l"),
    "4.1.4": ("straight right", "l_s l_r"),
    "4.1.5": ("straight left u_turn", "r_s r_l"),
    "4.1.6": ("left right u_turn", "s_r s_l"),
    "5.7.1": ("straight right u_turn", "l_s l_r"),
    "5.7.2": ("straight left u_turn", "r_s r_l"),
}


@pytest.fixture(scope="module")
def catalog() -> Catalog:
    return load_catalog()


def test_types_are_the_table(catalog: Catalog) -> None:
    rows = [
        f"{t.id} {','.join(t.codes)} {','.join(t.end_codes) or '-'} {t.group} {t.family}"
        for t in catalog.types
    ]
    assert rows == TABLE.split("\n")[1:-1]
    assert [t.row for t in catalog.types] == list(range(1, 30))
    assert Counter(t.group for t in catalog.types) == {
        "priority": 6,
        "speed": 4,
        "obstacles": 8,
        "routing": 11,
    }
    assert len(catalog.signs) == 34


@pytest.mark.parametrize("code", sorted(RULES))
def test_rules_have_the_thresholds_and_clauses_of_the_specification(catalog: Catalog, code: str) -> None:
    rule = catalog.sign(code).rule
    name, thresholds, clauses = RULES[code]
    assert (rule.name, dict(rule.thresholds)) == (name, thresholds)
    assert [clause.id for clause in rule.clauses] == clauses


def test_every_sign_has_a_checked_rule(catalog: Catalog) -> None:
    assert sorted(catalog.signs) == sorted(RULES)


@pytest.mark.parametrize("code", sorted(ALLOWED))
def test_turns_allow_what_the_specification_allows(catalog: Catalog, code: str) -> None:
    sign = catalog.sign(code)
    allowed, slots = ALLOWED[code]
    assert sorted(sign.rule.options["allowed"]) == sorted(allowed.split())
    assert sorted(sign.maps.slots) == sorted(slots.split())
    # The short way of each slot is prohibited, the compliant one is not.
    words = {"s": "straight", "l": "left", "r": "right"}
    for slot in sign.maps.slots:
        short, compliant = (words[letter] for letter in slot.split("_"))
        assert short not in sign.rule.options["allowed"]
        assert compliant in sign.rule.options["allowed"]


def test_options_tell_signs_of_one_rule_apart(catalog: Catalog) -> None:
    def chosen(option: str, *codes: str) -> list[tuple[str, ...]]:
        return [catalog.sign(code).rule.options[option] for code in codes]

    assert chosen("allowed_sides", "4.2.1", "4.2.2", "4.2.3") == [("right",), ("left",), ("right", "left")]
    assert chosen("priority_to", "2.1", "2.4", "2.5", "4.3") == [
        ("main_arm_on_right",),
        ("main_arms",),
        ("main_arms",),
        ("ring",),
    ]
    assert chosen("lane", "5.14.1", "5.14.2", "5.11.1", "5.11.2") == [
        ("rightmost",),
        ("rightmost",),
        ("leftmost",),
        ("leftmost",),
    ]
    assert chosen("users", "5.14.1", "5.14.2", "5.11.1", "5.11.2") == [
        ("bus",),
        ("bicycle",),
        ("bus",),
        ("bicycle",),
    ]
    assert chosen("users_direction", "5.14.1", "5.11.1") == [("same",), ("oncoming",)]


def test_zones_end_where_the_specification_says(catalog: Catalog) -> None:
    assert catalog.sign("3.24").rule.ended_by == ("3.25", "junction")
    assert catalog.sign("3.24").rule.ends_at_junction
    for code, end in (("5.21", "5.22"), ("5.31", "5.32")):
        assert catalog.sign(code).rule.ended_by == (end,)
        assert catalog.sign(end).ends == code
        assert catalog.sign(end).is_end


def test_values(catalog: Catalog) -> None:
    posted = {code: sign.value.allowed for code, sign in catalog.signs.items() if sign.value is not None}
    limits = (20.0, 30.0, 40.0)
    assert posted == {
        **dict.fromkeys(("3.24", "3.25", "5.31", "5.32"), limits),
        "4.6": (40.0, 50.0, 60.0),
        "5.21": (20.0,),
        "5.22": (20.0,),
    }
    assert catalog.sign("5.21").effective_value(None) == 20.0
    assert catalog.sign("3.24").effective_value(30.0) == 30.0
    assert catalog.sign("2.4").effective_value(None) is None
    for code, value in (("3.24", None), ("3.24", 35.0), ("2.4", 20.0), ("5.21", 30.0)):
        with pytest.raises(ValueError, match=code):
            catalog.sign(code).effective_value(value)


def test_shapes_and_lanes(catalog: Catalog) -> None:
    maps = {code: sign.maps for code, sign in catalog.signs.items()}
    assert [maps[code].shapes for code in ("2.3.1", "2.3.2", "2.3.3", "2.4")] == [
        ("X",),
        ("T",),
        ("T",),
        ("T", "X"),
    ]
    assert maps["4.3"].min_arms == 3
    assert (maps["5.19"].shapes, maps["5.19"].max_lanes) == (("straight", "curved"), 3)
    assert [maps[code].min_lanes for code in ("4.2.1", "4.2.3", "5.14.1", "5.11.1")] == [2, 3, 2, 2]
    assert [maps[code].one_way for code in ("5.14.1", "5.11.1", "5.11.2")] == [False, True, True]
    assert maps["4.6"].preferred_min_lanes == 2
    assert maps["5.31"].may_span_edges
    assert len(maps["3.1"].slots) == 6


def test_law_references_name_all_three_sources(catalog: Catalog) -> None:
    for sign in catalog.signs.values():
        assert "Appendix 1, section" in sign.law.pdd
        assert "52290" in sign.law.gost
        assert sign.law.vienna.startswith("Article ")
        assert "Annex 1" in sign.law.vienna


def test_sentences_name_sign_time_and_measure(catalog: Catalog) -> None:
    clause = catalog.rule("speed").clause("over_limit")
    said = clause.sentence(sign_code="3.24", time_s=4.2, value=57.3, threshold=41.0, margin=16.3)
    assert said == (
        "From 4.2 s the ego drove up to 57.3 km/h in the zone of sign 3.24 "
        "(at most 41 km/h with the tolerance)."
    )
    contact = catalog.rule("give_way").clause("contact")
    assert "touched lead" in contact.sentence(
        sign_code="2.4", time_s=1, value=0, threshold=0, margin=0, other="lead"
    )
    assert "another road user" in contact.sentence(sign_code="2.4", time_s=1, value=0, threshold=0, margin=0)
    with pytest.raises(KeyError, match="no clause"):
        catalog.rule("speed").clause("contact")


def test_one_word_options(catalog: Catalog) -> None:
    assert catalog.sign("4.2.1").rule.option("allowed_sides") == "right"
    with pytest.raises(ValueError, match="2 words"):
        catalog.sign("4.2.3").rule.option("allowed_sides")


def test_unknown_names_are_one_line(catalog: Catalog) -> None:
    with pytest.raises(InputError, match=r"no sign '9\.9'"):
        catalog.sign("9.9")
    with pytest.raises(InputError, match="no rule 'none'"):
        catalog.rule("none")
    with pytest.raises(InputError, match="no scenario type 'none'"):
        catalog.type("none")
    assert catalog.type("yield").codes == ("2.4",)


def test_one_yaml_adds_a_sign(catalog_copy: Path) -> None:
    text = (catalog_copy / "signs" / "3.18.2.yaml").read_text(encoding="utf-8")
    for old, new in (
        ('"3.18.2"', '"3.19"'),
        ("no_turn_left", "no_u_turn"),
        ("row: 21", "row: 30"),
        ("[straight, right, u_turn]", "[straight, right, left]"),
    ):
        text = text.replace(old, new)
    (catalog_copy / "signs" / "3.19.yaml").write_text(text, encoding="utf-8")
    grown = load_catalog(catalog_copy)
    assert grown.types[-1].codes == ("3.19",)
    assert grown.sign("3.19").rule.options["allowed"] == ("straight", "right", "left")
    assert list(grown.signs)[:2] == ["2.1", "2.3.1"]
    assert list(grown.signs).index("3.19") == list(grown.signs).index("3.18.2") + 1


def test_a_sign_may_override_a_threshold_of_its_rule(edited: Edit) -> None:
    root = edited("signs/2.4.yaml", "  name: give_way", "  name: give_way\n  thresholds:\n    gap_s: 5")
    assert load_catalog(root).sign("2.4").rule.thresholds == {**GIVE_WAY, "gap_s": 5.0}
    assert load_catalog(root).rule("give_way").thresholds["gap_s"] == 4.0


@pytest.mark.parametrize(
    ("name", "old", "new", "same"),
    [
        ("signs/2.4.yaml", "schema: 1", "# a remark\nschema: 1", True),
        ("signs/2.4.yaml", "en: Give way", "en: Yield", True),
        ("signs/2.4.yaml", "[T, X]", "[T]", False),
        ("rules/give_way.yaml", "gap_s: 4.0", "gap_s: 4.1", False),
        ("rules/give_way.yaml", "crossed the line", "passed the line", False),
    ],
)
def test_fingerprint_follows_the_content_and_not_its_form(
    catalog: Catalog, edited: Edit, name: str, old: str, new: str, same: bool
) -> None:
    assert (load_catalog(edited(name, old, new)).fingerprint() == catalog.fingerprint()) is same
