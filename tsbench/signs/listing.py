"""The catalogue as tables for the terminal."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Country
from tsbench.signs.model import MapNeeds, Placement, PostedValue, RuleSpec, Sign


def sign_table(catalog: Catalog) -> Table:
    """All signs in the order of the scenario types' rows, end plates behind the sign that they end."""
    table = Table(caption=_caption(catalog), box=None, pad_edge=False)
    for heading in ("#", "type", "group", "sign", "name", "sets"):
        table.add_column(heading, no_wrap=heading != "name")
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
    title = Text(f"{sign.code}  {sign.name_en}", style="bold")
    return Group(
        title,
        facts,
        Text(),
        Text(sign.rule.description),
        Text(),
        _parameters(sign.rule),
        Text(),
        _clauses(sign.rule),
    )


def countries_table(countries: Sequence[Country]) -> Table:
    """Per country: how many signs have an equivalent, the published share, and how many entries are checked."""
    table = Table(box=None, pad_edge=False)
    for heading in ("country", "", "numbering"):
        table.add_column(heading, no_wrap=heading != "numbering")
    for heading in ("signs", "share", "published", "checked"):
        table.add_column(heading, justify="right", no_wrap=True)
    for country in countries:
        numbers = (f"{country.count}/{len(country.equivalents)}", f"{country.percent:.0f} %")
        published = f"{country.published_percent:g} %"
        row = (country.code, country.name_en, country.numbering, *numbers, published, str(country.checked))
        table.add_row(*row)
    return table


def country_table(catalog: Catalog, country: Country) -> Table:
    """One country's sign for each sign of the catalogue; "memory" marks what rests on no source."""
    caption = f"{country.count} of {len(country.equivalents)} signs, {country.checked} entries checked"
    table = Table(title=f"{country.name_en}: {country.numbering}", caption=caption, box=None, pad_edge=False)
    for heading in ("sign", "name", "equivalent", "", "remark"):
        table.add_column(heading, no_wrap=heading not in ("name", "remark"))
    for entry in country.equivalents.values():
        remark = entry.reason or entry.note or ""
        name = catalog.sign(entry.sign).name_en
        table.add_row(entry.sign, name, entry.code or "none", "" if entry.checked else "memory", remark)
    return table


def _caption(catalog: Catalog) -> str:
    return f"{len(catalog.signs)} signs, {len(catalog.types)} scenario types"


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


def _parameters(rule: RuleSpec) -> Table:
    table = Table("threshold", "value", box=None, pad_edge=False)
    for key, number in rule.thresholds.items():
        table.add_row(key, f"{number:g}")
    for key, words in rule.options.items():
        table.add_row(key, ", ".join(words))
    return table


def _clauses(rule: RuleSpec) -> Table:
    table = Table("clause", "a violation is", box=None, pad_edge=False)
    for clause in rule.clauses:
        table.add_row(clause.id, clause.description)
    return table
