"""Writes docs/dataset.md: the data set in figures, with more tables as CSV beside it, in `tables/`.

Beside what `tsbench scenarios stats` prints: in what rows of a map differ, and maps from the generalised extract.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean

import click

from tsbench.cli.console import bars
from tsbench.core.files import write_atomic
from tsbench.make.city import load_city
from tsbench.make.scenes.overview import build_report, dataset_tables, percent, report_file, type_stats
from tsbench.make.scenes.recipe import load_recipes, stratum_of
from tsbench.make.scenes.split import split_pool
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, to_csv, to_markdown
from tsbench.report.analyses.columns import count_columns, text_columns
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.sim.scene import SceneLayout

# The columns of the page's own table: as many as are as wide as a page.
_SHOWN = ("type", "rows", "pairs", "places", "tagged", "gap_s", "seen")
Progress = Callable[[int, int], None]
# What rows differ in, with heads: distinct values in a type, distinct values on a map (mean over maps), and shares of
# rows that differ from every other row of their map.
_IN_TYPE = {"plates": "plates and values", "speeds": "initial speeds", "densities": "densities"}
_ON_MAP = {
    "distractors": "sets of distractors",
    "lanes": "start lanes",
    "destinations": "destinations",
    "approaches": "approaches",
    "lengths": "route lengths",
}
_APART = {"apart": "apart", "apart_bare": "apart without distractors"}
Axes = dict[str, float]
# Of a routing type's test maps at most this share is to be from the generalised extract (docs/scenes.md).
GOAL = 0.3
ROUTING = "routing"


def axes_table(axes: Mapping[tuple[str, str], Axes]) -> Analysis:
    """In what a type's rows differ, by type and split."""
    columns = (
        *text_columns("type", "split"),
        *count_columns(**_IN_TYPE),
        *(Column(key, head, Kind.NUMBER) for key, head in _ON_MAP.items()),
        *text_columns(*_APART.values()),
    )
    rows = []
    for key, found in axes.items():
        numbers = (found[name] for name in (*_IN_TYPE, *_ON_MAP))
        rows.append(Row((*key, *numbers, *(percent(found[name]) for name in _APART))))
    notes = (
        "Signed rows. Plates and values, initial speeds and densities: distinct ones in the type. The next five: "
        "distinct ones on a map, mean over maps. apart: % of rows that differ from every other row of their map in "
        "plate, value, distractors, start lane, approach or destination",
    )
    return Analysis("dataset-axes", "In what the rows of a map differ", "", Table(columns, tuple(rows), 2), notes)


def tagging_table(found: Sequence[Tagging]) -> Analysis:
    """Maps from the generalised extract, by type and split."""
    columns = (
        *text_columns("type", "split"),
        *count_columns("maps", "tagged", there="tagged in the pool"),
        *text_columns("generalised"),
    )
    rows = [Row((t.type_id, t.split, t.maps, t.tagged, t.there, percent(t.share))) for t in found]
    return Analysis("dataset-tagging", "Tagging", "", Table(columns, tuple(rows), 2), (_tagging_note(found),))


def _tagging_note(found: Sequence[Tagging]) -> str:
    """Whether routing types keep the goal for generalised maps, split by split."""
    parts = []
    for split in dict.fromkeys(t.split for t in found if t.routing):
        of = [t for t in found if t.routing and t.split == split]
        over = [t for t in of if t.share > GOAL]
        share = percent(sum(t.plain for t in of) / sum(t.maps for t in of))
        parts.append(f"{split}: {share} % generalised, {len(over)} of {len(of)} types above the goal")
    goal = f"At most {GOAL:.0%} of a routing type's test maps are to be from the generalised extract. "
    reason = (
        ". A build tries the tagged maps of a stratum first and takes a generalised one where no more of them pass. "
        "Most of those passed over have an obedient way that takes too long; the table of quotas counts the reasons"
    )
    return goal + "Routing types, " + "; ".join(parts) + reason if parts else ""


def dataset_page(tables: Sequence[Analysis]) -> str:
    """The test split of the first table, and what stands in the files of all."""
    head = "# The data set in figures\n\nMade by `packaging/dataset_page.py`.\n"
    first, *others = tables
    keys = [column.key for column in first.table.columns]
    shown = [keys.index(key) for key in _SHOWN]
    rows = tuple(
        Row(tuple(row.cells[k] for k in shown)) for row in first.table.rows if row.cells[keys.index("split")] == "test"
    )
    test = Table(tuple(first.table.columns[k] for k in shown), rows, 1)
    parts = [head, to_markdown(replace(first, table=test))]
    parts.append(f"The table shows the test split. All splits and shares: {_link(first)}.\n\n## More tables\n")
    for analysis in others:
        columns = ", ".join(column.head for column in analysis.table.columns)
        notes = "".join(f" {note.removesuffix('.')}." for note in analysis.notes if note)
        parts.append(f"* {_link(analysis)}: **{analysis.title}.** Columns: {columns}.{notes}")
    return "\n".join(parts) + "\n"


def _link(analysis: Analysis) -> str:
    return f"[`tables/{analysis.name}.csv`](tables/{analysis.name}.csv)"


@dataclass(frozen=True)
class Asked:
    """What one row asks: the plate and its value, other plates, where the ego starts, and where it is to arrive."""

    plate: tuple[str, float | None]
    approach: str
    distractors: tuple[tuple[str, float | None, str], ...]
    lane: str
    destination: str

    @property
    def bare(self) -> tuple[object, ...]:
        return (self.plate, self.approach, self.lane, self.destination)


def asked_of(layout: SceneLayout) -> Asked:
    target = next(sign for sign in layout.signs if sign.id == layout.targets[0])
    others = sorted((sign.code, sign.value, sign.edge) for sign in layout.signs if sign.role == DISTRACTOR)
    return Asked((target.code, target.value), target.edge, tuple(others), layout.start.lane, layout.destination.edge)


def type_axes(data: DataSet, specs: Sequence[ScenarioSpec], progress: Progress) -> dict[tuple[str, str], Axes]:
    """One entry per type and split, in alphabetical order. Reads each signed row's scene. Raises InputError."""
    loader = SceneLoader(data)
    # Rows of a map one after the other: the store unpacks a map at a time.
    signed = sorted(
        (s for s in specs if s.scenario_id == s.pair_name), key=lambda s: (s.split, s.pair_type, s.map_id, s.variant)
    )
    groups: dict[tuple[str, str], list[tuple[ScenarioSpec, Asked]]] = defaultdict(list)
    for number, spec in enumerate(signed):
        progress(number + 1, len(signed))
        asked = asked_of(loader.layout(spec)[1])
        groups[(spec.pair_type, spec.split)].append((spec, asked))
    return {key: axes_of(rows) for key, rows in sorted(groups.items())}


def axes_of(rows: Sequence[tuple[ScenarioSpec, Asked]]) -> Axes:
    maps: dict[str, list[tuple[ScenarioSpec, Asked]]] = defaultdict(list)
    for spec, asked in rows:
        maps[spec.map_id].append((spec, asked))

    def on_a_map(value: Callable[[ScenarioSpec, Asked], object]) -> float:
        return mean(len({value(*row) for row in of}) for of in maps.values())

    def apart(value: Callable[[Asked], object]) -> float:
        alone = 0
        for of in maps.values():
            tally = Counter(value(asked) for _, asked in of)
            alone += sum(count == 1 for count in tally.values())
        return alone / len(rows)

    return {
        "plates": len({asked.plate for _, asked in rows}),
        "speeds": len({spec.initial_speed for spec, _ in rows}),
        "densities": len({spec.density for spec, _ in rows}),
        "distractors": on_a_map(lambda _, asked: asked.distractors),
        "lanes": on_a_map(lambda _, asked: asked.lane),
        "destinations": on_a_map(lambda _, asked: asked.destination),
        "approaches": on_a_map(lambda _, asked: asked.approach),
        "lengths": on_a_map(lambda spec, _: spec.route_length),
        "apart": apart(lambda asked: asked),
        "apart_bare": apart(lambda asked: asked.bare),
    }


@dataclass(frozen=True)
class Tagging:
    """Maps of a type in one split. plain: from the generalised extract. there: tagged maps of the pool in that split.

    `there` counts what the recipe's strata admit. A build tries these before any plain map of the same stratum.
    """

    type_id: str
    split: str
    routing: bool
    maps: int
    plain: int
    there: int

    @property
    def share(self) -> float:
        return self.plain / self.maps

    @property
    def tagged(self) -> int:
        return self.maps - self.plain


def tagging(data: DataSet, specs: Sequence[ScenarioSpec]) -> list[Tagging]:
    """One entry per type and split, in alphabetical order. Raises InputError."""
    pool = read_pool(data.pool_path)
    known, split_of = {row.map_id: row for row in pool}, split_pool(pool, load_city(data.name).split)
    used: dict[tuple[str, str], set[str]] = defaultdict(set)
    for spec in specs:
        used[(spec.pair_type, spec.split)].add(spec.map_id)
    found = []
    recipes = {recipe.type.id: recipe for recipe in load_recipes(data.catalog, {type_id for type_id, _ in used})}
    for (type_id, split), maps in sorted(used.items()):
        recipe = recipes[type_id]
        there = sum(
            row.well_tagged
            and row.family == recipe.type.family
            and split_of[row.map_id] == split
            and stratum_of(row) in recipe.maps
            for row in pool
        )
        plain = sum(not known[one].well_tagged for one in maps)
        found.append(Tagging(type_id, split, recipe.type.group == ROUTING, len(maps), plain, there))
    return found


@click.command()
@click.argument("page", type=click.Path(path_type=Path), default="docs/dataset.md")
def main(page: Path) -> None:
    """Write PAGE and its tables."""
    data = DataSet()
    rows = [row for split in data.splits for row in data.table(split)]
    counted, quotas = dataset_tables(type_stats(data, rows), build_report(report_file(data)))
    with bars() as show:
        axes = type_axes(data, rows, lambda done, of: show("scenes", done, of))
    tables = (counted, axes_table(axes), tagging_table(tagging(data, rows)), quotas)
    for table in tables:
        write_atomic(page.parent / "tables" / f"{table.name}.csv", to_csv(table).encode())
    write_atomic(page, dataset_page(tables).encode())


if __name__ == "__main__":
    main()
