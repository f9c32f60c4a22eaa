"""docs/signs.md against the catalogue."""

from __future__ import annotations

import re
from collections import Counter

from spec_tables import Row, table

from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import load_countries
from tsbench.signs.model import ScenarioType

CATALOG = load_catalog()
TYPES = table("signs.md", "row", "type", "plates", "map family")
CODE = re.compile(r"\d+(?:\.\d+)+")


def of_the_catalogue(type_: ScenarioType) -> dict[str, object]:
    """What the table says of a type, from the catalogue: what any of its plates may stand on."""
    maps = [CATALOG.sign(code).maps for code in type_.codes]
    return {
        "row": type_.row,
        "type": type_.id,
        "codes": list(type_.codes),
        "ends": list(type_.end_codes),
        "group": type_.group,
        "family": type_.family,
        "shapes": {shape for m in maps for shape in m.shapes} & {"T", "X", "straight", "curved"},
        "slots": {slot for m in maps for slot in m.slots},
        "lanes": (maps[0].min_lanes, maps[0].preferred_min_lanes, maps[0].max_lanes, maps[0].one_way),
    }


def of_the_page(row: Row) -> dict[str, object]:
    plates, _, ends = row["plates"].partition("ended by")
    where = row["shapes, slots"]
    slots = set(re.findall(r"\b[slr]_[slr]\b", where))
    if "any slot" in where:
        slots = {"s_l", "s_r", "l_s", "l_r", "r_s", "r_l"}
    least = re.search(r">= (\d)( preferred)?", row["lanes"])
    most = re.search(r"<= (\d)", row["lanes"])
    number = int(least.group(1)) if least else None
    wished = bool(least and least.group(2))
    return {
        "row": int(row["row"]),
        "type": row["type"],
        "codes": CODE.findall(plates),
        "ends": CODE.findall(ends),
        "group": row["group"].lower(),
        "family": row["map family"].replace(" ", "_"),
        # On dual paths a slot lies on a T or an X.
        "shapes": {"T", "X"} if slots else set(re.findall(r"\b(?:T|X|straight|curved)\b", where)),
        "slots": slots,
        "lanes": (
            None if wished else number,
            number if wished else None,
            int(most.group(1)) if most else None,
            "one-way" in row["lanes"],
        ),
    }


def test_the_types_are_those_of_the_catalogue() -> None:
    assert [of_the_page(row) for row in TYPES] == [of_the_catalogue(type_) for type_ in CATALOG.types]


def test_the_counts() -> None:
    assert [int(row["row"]) for row in TYPES] == list(range(1, 30))
    assert Counter(row["group"] for row in TYPES) == {"Priority": 6, "Speed": 4, "Obstacles": 8, "Routing": 11}
    named = [code for row in TYPES for code in CODE.findall(row["plates"])]
    assert sorted(named) == sorted(CATALOG.signs)
    assert len(named) == 34
    assert CATALOG.sign("4.3").maps.min_arms == 3
    assert CATALOG.sign("5.31").maps.may_span_edges


def test_the_plates_of_a_secondary_road_stand_on_their_shapes() -> None:
    assert [CATALOG.sign(code).maps.shapes for code in ("2.3.1", "2.3.2", "2.3.3")] == [("X",), ("T",), ("T",)]


def test_the_countries_have_the_equivalents_that_the_page_says() -> None:
    page = {row["country"]: row for row in table("signs.md", "country", "published")}
    assert set(page) == {country.name_en for country in load_countries()}
    for country in load_countries():
        row = page[country.name_en]
        assert row["numbering"] == country.numbering
        assert (int(row["equivalents"]), int(row["checked"])) == (country.count, country.checked)
        assert row["published"] == f"{country.published_percent:.0f} %"
        assert row["share"] == f"{country.percent:.0f} %"
