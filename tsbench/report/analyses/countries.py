"""What the signs are called in other countries, as tables of the paper."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table
from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Country


def countries_analysis(countries: Sequence[Country]) -> Analysis:
    columns = (
        Column("country", "country", Kind.TEXT), Column("name", "name", Kind.TEXT),
        Column("numbering", "numbering", Kind.TEXT), Column("equivalents", "with\nequivalent", Kind.COUNT),
        Column("signs", "signs", Kind.COUNT), Column("share", "share\n%", Kind.NUMBER, 0),
        Column("published", "published\n%", Kind.NUMBER, 0), Column("checked", "checked", Kind.COUNT),
    )  # fmt: skip
    rows = tuple(
        Row((
            c.code, c.name_en, c.numbering, c.count, c.known, c.percent, c.published_percent,
            c.checked,
        ))
        for c in countries
    )  # fmt: skip
    notes = (
        "with equivalent: signs by which the country tells a driver the same; published: the share that the reference "
        "quotes; checked: entries found in a source",
    )
    title = f"Country equivalents of {len(countries[0].equivalents)} signs"
    return Analysis("countries", title, "", Table(columns, rows, 3), notes)


def country_analysis(catalog: Catalog, country: Country) -> Analysis:
    keys = ("sign", "name", "equivalent", "source", "remark")
    rows = tuple(
        Row((
            sign, catalog.sign(sign).name_en, entry.code,
            "checked" if entry.checked else "memory", entry.reason or entry.note or "",
        ))
        for sign, entry in country.equivalents.items()
    )  # fmt: skip
    title = f"{country.name_en}: {country.count} of {country.known} signs have an equivalent"
    columns = tuple(Column(key, key, Kind.TEXT) for key in keys)
    return Analysis(f"country-{country.code}", title, "", Table(columns, rows, 5), (country.numbering,))
