"""The catalogue as tables for the terminal."""

from collections.abc import Mapping, Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Country
from tsbench.signs.model import MapNeeds, Placement, PostedValue, Sign


def sign_table(catalog: Catalog) -> Table:
    """All signs in the order of the scenario types' rows, end plates behind the sign that they end."""
    caption = f"{len(catalog.signs)} signs, {len(catalog.types)} scenario types"
    table = Table(caption=caption, box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in ("#", "type", "group", "sign", "name", "sets"):
        named = heading == "name"
        table.add_column(heading, no_wrap=not named, overflow="fold", min_width=12 if named else None)
    for kind in catalog.types:
        for code in (*kind.codes, *kind.end_codes):
            sign = catalog.sign(code)
            values = "" if sign.value is None else _values(sign.value)
            table.add_row(str(kind.row), kind.id, kind.group, code, sign.name_en, values)
    return table


def sign_page(sign: Sign) -> Group:
    """Everything that the catalogue says about one sign: facts, thresholds, clauses."""
    facts = Table.grid(padding=(0, 2))
    rows = {
        "Russian name": sign.name_ru,
        "scenario type": f"{sign.type_id} (row {sign.type_row}, {sign.group})",
        "ends": sign.ends or "",
        "ended by": ", ".join(word.replace("_", " ") for word in sign.rule.ended_by),
        "sets": "" if sign.value is None else _values(sign.value),
        "plate stands": _placement(sign.placement),
        "maps": _maps(sign.maps),
        "ПДД": sign.law.pdd,
        "GOST": sign.law.gost,
        "Vienna Convention": sign.law.vienna,
        "rule": sign.rule.name,
    }
    for name, text in rows.items():
        if text:
            facts.add_row(Text(name, style="dim"), Text(text))
    rule = sign.rule
    thresholds = {key: f"{number:g}" for key, number in rule.thresholds.items()}
    options = {key: ", ".join(words) for key, words in rule.options.items()}
    numbers = _two_columns("threshold", "value", {**thresholds, **options})
    clauses = _two_columns("clause", "a violation is", {c.id: c.description for c in rule.clauses})
    title = Text(f"{sign.code}  {sign.name_en}", style="bold")
    return Group(title, facts, Text(), Text(rule.description), Text(), numbers, Text(), clauses)


def countries_table(countries: Sequence[Country]) -> Table:
    """Per country: how many signs have an equivalent, the published share, and how many entries are checked."""
    table = Table(box=None, pad_edge=False)
    for heading in ("country", "", "numbering"):
        table.add_column(heading, no_wrap=heading != "numbering")
    for heading in ("signs", "share", "published", "checked"):
        table.add_column(heading, justify="right", no_wrap=True)
    for country in countries:
        numbers = (f"{country.count}/{country.known}", f"{country.percent:.0f} %")
        published = "" if country.published_percent is None else f"{country.published_percent:g} %"
        row = (country.code, country.name_en, country.numbering, *numbers, published, str(country.checked))
        table.add_row(*row)
    return table


def country_table(catalog: Catalog, country: Country) -> Table:
    """One country's sign for each sign of the catalogue; "memory" marks what rests on no source."""
    caption = f"{country.count} of {country.known} signs, {country.checked} entries checked"
    table = Table(title=f"{country.name_en}: {country.numbering}", caption=caption, box=None, pad_edge=False)
    for heading in ("sign", "name", "equivalent", "", "remark"):
        table.add_column(heading, no_wrap=heading not in ("name", "remark"))
    for sign, entry in country.equivalents.items():
        source = "" if entry.checked or entry.code == "unknown" else "memory"
        table.add_row(sign, catalog.sign(sign).name_en, entry.code, source, entry.reason or entry.note or "")
    return table


def _values(value: PostedValue) -> str:
    numbers = "/".join(f"{number:g}" for number in value.allowed)
    return f"{numbers} {value.unit}" + ("" if value.printed else " implied")


def _placement(placement: Placement) -> str:
    least, greatest = placement.distance_m
    distance = f"{least:g} m" if least == greatest else f"{least:g}-{greatest:g} m"
    where = {
        "line": f"{distance} before the line",
        "exit_start": f"{distance} into the exit",
        "crossing": f"{distance} before the crossing",
        "obstacle": f"{distance} before the obstacle",
        "own_line": "at the line that it makes itself",
    }[placement.reference]
    side = "on the obstacle" if placement.side == "obstacle" else f"on the {placement.side}"
    return f"{side}, {placement.edge.replace('_', '-')}, {where}, facing {placement.faces.replace('_', ' ')}"


def _maps(maps: MapNeeds) -> str:
    bounds = {
        "slots": ", ".join(maps.slots),
        "lanes at least": maps.min_lanes,
        "lanes at most": maps.max_lanes,
        "lanes preferably at least": maps.preferred_min_lanes,
        "arms at least": maps.min_arms,
        "one-way": "yes" if maps.one_way else None,
        "several edges": "yes" if maps.may_span_edges else None,
    }
    parts = [f"{maps.family.replace('_', ' ')} ({', '.join(maps.shapes)})"]
    return "; ".join(parts + [f"{name} {bound}" for name, bound in bounds.items() if bound])


def _two_columns(first: str, second: str, rows: Mapping[str, str]) -> Table:
    table = Table(first, second, box=None, pad_edge=False)
    for row in rows.items():
        table.add_row(*row)
    return table
