"""What the signs are called in other countries, as tables of the paper."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table
from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Country


def countries_analysis(countries: Sequence[Country]) -> Analysis:
    """One row for each country: how many of the signs have an equivalent there."""
    columns = (
        Column("country", "country", Kind.TEXT), Column("name", "name", Kind.TEXT),
        Column("numbering", "numbering", Kind.TEXT), Column("equivalents", "with\nequivalent", Kind.COUNT),
        Column("signs", "signs", Kind.COUNT), Column("share", "share\n%", Kind.NUMBER, 0),
        Column("published", "published\n%", Kind.NUMBER, 0), Column("checked", "checked", Kind.COUNT),
    )  # fmt: skip
    rows = tuple(
        Row((
            c.code, c.name_en, c.numbering, c.count, len(c.equivalents), c.percent, float(c.published_percent),
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
    """One row for each sign: its equivalent in one country."""
    keys = ("sign", "name", "equivalent", "source", "remark")
    rows = tuple(
        Row((
            entry.sign, catalog.sign(entry.sign).name_en, entry.code or "none",
            "checked" if entry.checked else "memory", entry.reason or entry.note or "",
        ))
        for entry in country.equivalents.values()
    )  # fmt: skip
    title = f"{country.name_en}: {country.count} of {len(country.equivalents)} signs have an equivalent"
    columns = tuple(Column(key, key, Kind.TEXT) for key in keys)
    return Analysis(f"country-{country.code}", title, "", Table(columns, rows, 5), (country.numbering,))
