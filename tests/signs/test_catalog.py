"""The catalogue's signs and rules. What the specification's tables say of them: tests/spec."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tsbench.core.errors import InputError
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.countries import Artwork
from tsbench.signs.plates import plate_rgba

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


def test_zones_end_where_the_specification_says(catalog: Catalog) -> None:
    assert catalog.sign("3.24").rule.ended_by == ("3.25", "junction")
    assert catalog.sign("3.24").rule.ends_at_junction
    for code, end in (("5.21", "5.22"), ("5.31", "5.32")):
        assert catalog.sign(code).rule.ended_by == (end,)
        assert catalog.sign(end).ends == code
        assert catalog.sign(end).is_end


def test_values(catalog: Catalog) -> None:
    assert catalog.sign("5.21").effective_value(None) == 20.0
    assert catalog.sign("3.24").effective_value(30.0) == 30.0
    assert catalog.sign("2.4").effective_value(None) is None
    for code, value in (("3.24", None), ("3.24", 35.0), ("2.4", 20.0), ("5.21", 30.0)):
        with pytest.raises(ValueError, match=code):
            catalog.sign(code).effective_value(value)


@pytest.mark.parametrize("code", load_catalog().signs)
def test_the_outline_of_each_sign_is_that_of_its_drawing(catalog: Catalog, code: str) -> None:
    sign = catalog.sign(code)
    value = sign.value.allowed[0] if sign.value and sign.value.printed else None
    there = plate_rgba(Artwork(catalog), code, value, 200)[..., 3] > 128
    rows, columns = (np.flatnonzero(there.any(axis=axis)) for axis in (1, 0))
    box = there[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    # Shares of the bounding box: of all of it, and of its edges at the top and at the bottom.
    filled, top, bottom = box.mean(), box[2].mean(), box[-3].mean()
    found = (
        ("rectangle" if filled > 0.9 else "octagon" if filled > 0.81 else "circle")
        if filled > 0.7
        else "triangle" if bottom > 0.6 else "inverted_triangle" if top > 0.6 else "diamond"
    )  # fmt: skip
    assert sign.outline == found


def test_what_outlines_alone_say(catalog: Catalog) -> None:
    said = {"diamond": "2.1", "triangle": "2.3.1", "inverted_triangle": "2.4", "octagon": "2.5"}
    assert catalog.code_of_outline == said
    others = [sign for sign in catalog.signs.values() if sign.outline == "triangle"]
    assert {sign.code for sign in others} == {"2.3.1", "2.3.2", "2.3.3"}
    # They ask the same: from behind it does not matter which of them it is.
    assert all(sign.rule == others[0].rule for sign in others)


def test_sentences_name_sign_time_and_measure(catalog: Catalog) -> None:
    clause = catalog.rule("speed").clause("over_limit")
    said = clause.sentence(sign_code="3.24", time_s=4.2, value=57.3, threshold=41.0, margin=16.3)
    assert said == (
        "From 4.2 s the ego drove up to 57.3 km/h in the zone of sign 3.24 (at most 41 km/h with the tolerance)."
    )
    blocked = catalog.rule("give_way").clause("entered_while_blocked")
    for value, words in ((3.44, "with 3.4 s"), (3.96, "with 3.96 s"), (3.99996, "with 4.000 s")):
        said = blocked.sentence(sign_code="2.4", time_s=1, value=value, threshold=4.0, margin=4.0 - value)
        assert words in said
    contact = catalog.rule("give_way").clause("contact")
    assert "touched lead" in contact.sentence(sign_code="2.4", time_s=1, value=0, threshold=0, margin=0, other="lead")
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
    catalog.check_plates(["2.1"], {plate.id: plate.code}, "row")
    with pytest.raises(
        InputError, match=r"row: plate 'a' is 2.4, in a scene of 2.5 may stand 2.5, 2.1 \(context: in .*2.5.yaml"
    ):
        catalog.check_plates(["2.5"], {plate.id: plate.code}, "row")


@pytest.mark.parametrize(
    ("code", "name", "speeds"),
    [
        ("3.24", "primary", (30.0, 40.0, 50.0, 60.0)),
        ("3.24", "primary_link", (30.0, 40.0, 50.0, 60.0)),
        ("3.24", "trunk", (40.0, 50.0, 60.0, 70.0)),
        ("3.24", "trunk_link", (40.0, 50.0, 60.0)),
        ("5.31", "primary", ()),
        ("5.21", "unclassified", ()),
        ("5.21", "", None),
    ],
)
def test_a_ramp_has_the_speeds_of_its_road_unless_it_has_its_own(
    code: str, name: str, speeds: tuple[float, ...] | None
) -> None:
    assert load_catalog().allowed_speeds(road_class=name and f"highway.{name}", code=code) == speeds


def test_types_with_several_signs_stay_what_they_are_in_the_mirror() -> None:
    catalog = load_catalog(mirrored=True)
    assert [catalog.mirrored_type(kind.id) for kind in catalog.combined] == [kind.id for kind in catalog.combined]
    assert catalog.mirrored_type("detour_left") == "detour_right"
