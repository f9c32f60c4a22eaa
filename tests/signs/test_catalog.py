"""The catalogue's signs and rules. What the specification's tables say of them: tests/spec."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog, load_catalog

Edit = Callable[[str, str, str], Path]


@pytest.fixture(scope="module")
def catalog() -> Catalog:
    return load_catalog()


def test_the_short_way_of_a_slot_is_prohibited_and_the_long_one_is_not(catalog: Catalog) -> None:
    words = {"s": "straight", "l": "left", "r": "right"}
    signs = [sign for sign in catalog.signs.values() if "allowed" in sign.rule.options]
    assert len(signs) == 10
    for sign in signs:
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
    limits = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0)
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
    assert [maps[code].min_lanes for code in ("4.2.1", "4.2.3", "5.14.1", "5.11.1")] == [3, 3, 3, 2]
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
    blocked = catalog.rule("give_way").clause("entered_while_blocked")
    for value, words in ((3.44, "with 3.4 s"), (3.96, "with 3.96 s"), (3.99996, "with 4.000 s")):
        said = blocked.sentence(sign_code="2.4", time_s=1, value=value, threshold=4.0, margin=4.0 - value)
        assert words in said
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
        ('mirrored: "3.18.1"\n', ""),
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
    defaults = load_catalog().rule("give_way").thresholds
    assert load_catalog(root).sign("2.4").rule.thresholds == {**defaults, "gap_s": 5.0}
    assert load_catalog(root).rule("give_way").thresholds == defaults


@pytest.mark.parametrize(
    ("name", "old", "new", "same"),
    [
        ("signs/2.4.yaml", "schema: 1", "# a remark\nschema: 1", True),
        ("signs/2.4.yaml", "en: Give way", "en: Yield", True),
        ("signs/2.4.yaml", "[T, X]", "[T]", False),
        ("rules/give_way.yaml", "gap_s: 4.0", "gap_s: 4.1", False),
        ("rules/give_way.yaml", "had to brake", "braked", False),
    ],
)
def test_what_is_judged_follows_the_content_and_not_its_form(
    catalog: Catalog, edited: Edit, name: str, old: str, new: str, same: bool
) -> None:
    changed = load_catalog(edited(name, old, new))
    assert (changed.contract_entries(["2.4"]) == catalog.contract_entries(["2.4"])) is same
    # Signs that have nothing to do with it stay what they are.
    assert changed.contract_entries(["3.24"]) == catalog.contract_entries(["3.24"])


def test_a_sign_stands_with_what_ends_it_and_its_context(catalog: Catalog) -> None:
    assert catalog.allowed_codes("3.24") == ("3.24", "3.25")
    assert catalog.allowed_codes("2.1") == ("2.1", "2.4")
    *signs, everywhere = catalog.contract_entries(["5.21", "2.1", "2.1"])
    assert [entry["code"] for entry in signs] == ["2.1", "2.4", "5.21", "5.22"]
    assert everywhere["name"] == "wrong_way"


def test_a_plate_that_the_catalogue_does_not_expect_is_refused(catalog: Catalog) -> None:
    plate = SignInstance("a", "2.4", None, "edge", 0, 1.0, 0.0, 0.0, 0.0, "context")
    catalog.check_plates("2.1", {plate.id: plate.code}, "row")
    with pytest.raises(
        InputError,
        match=r"row: plate 'a' is 2.4, in a scene of 2.5 may stand 2.5, 2.1 \(context: in .*2.5.yaml",
    ):
        catalog.check_plates("2.5", {plate.id: plate.code}, "row")
