"""The data set in tables: rows by type and split, in what they differ, tagging, and the quotas and maps behind them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from statistics import mean
from typing import Any

from tsbench.make.city import load_city
from tsbench.make.scenes.overview import TypeStats, shown_reason
from tsbench.make.scenes.recipe import load_recipes, stratum_of
from tsbench.make.scenes.split import split_pool
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, to_markdown
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import SIGNED, ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.sim.scene import SceneLayout

_SAME = ("solvable", "tempting", "engaged", "sane")
_SHARES = {"tagged": "tagged_share", **{name: name for name in _SAME}, "again": "reproduced"}
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


def dataset_tables(stats: Sequence[TypeStats], report: Sequence[Mapping[str, Any]]) -> tuple[Analysis, Analysis]:
    """Rows, and maps. report: what the last build wrote down (overview.build_report)."""
    splits = dict.fromkeys(t.split for t in stats)
    counts = {split: sum(t.rows for t in stats if t.split == split) for split in splits}
    by_split = ", ".join(f"{split} {count:,}" for split, count in counts.items())
    rows = []
    for t in stats:
        shares = (_percent(getattr(t, name)) for name in _SHARES.values())
        gap, seen = None if isnan(t.gap_s) else t.gap_s, "" if isnan(t.seen) else _percent(t.seen)
        rows.append(Row((t.type_id, t.split, t.rows, t.pairs, t.maps, t.places, *shares, gap, seen)))
    columns = (
        *text_columns("type", "split"),
        *count_columns("rows", "pairs", "maps", "places"),
        *text_columns(*_SHARES),
        *number_columns(gap_s="gap s"),
        *text_columns("seen"),
    )
    notes = (
        "Shares are of signed rows, in %, by their certificates. places: maps of the split within 300 m of each other, "
        "of one ring or one OSM way are one. "
        "tagged: maps from extracts with full tags. again: driven to the same bytes by a second process. gap s: median "
        "of |arrival gap| between the ego and the road users that it has to watch, where there are any. "
        "seen: pairs whose others "
        "betray the half before the ego is at its line, though too late to stop",
    )
    title = f"The data set: {sum(counts.values()):,} rows ({by_split})"
    strata = {(t.type_id, t.split): t.strata for t in stats}
    maps = tuple(
        Row(
            (
                kind,
                split,
                _counts(strata.get((kind, split), {})),
                _counts(e["missed"]),
                _reasons(e["reasons"]),
                _reasons(e.get("draws", {})),
            )
        )
        for e in report
        for kind, split in [(str(e["type_id"]), str(e["split"]))]
    )
    heads = text_columns(
        "type", "split", "maps by stratum", "quota missed", "maps passed over, by reason", "draws passed over"
    )
    quotas = "Quotas, and why maps were passed over while they were filled"
    return (
        Analysis("dataset-rows", title, "", Table(columns, tuple(rows), 2), notes),
        Analysis("dataset-maps", quotas, "", Table(heads, maps, 2), ()),
    )


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
        rows.append(Row((*key, *numbers, *(_percent(found[name]) for name in _APART))))
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
    rows = [Row((t.type_id, t.split, t.maps, t.tagged, t.there, _percent(t.share))) for t in found]
    return Analysis("dataset-tagging", "Tagging", "", Table(columns, tuple(rows), 2), (_tagging_note(found),))


def _tagging_note(found: Sequence[Tagging]) -> str:
    """Whether routing types keep the goal for generalised maps, split by split."""
    parts = []
    for split in dict.fromkeys(t.split for t in found if t.routing):
        of = [t for t in found if t.routing and t.split == split]
        over = [t for t in of if t.share > GOAL]
        share = _percent(sum(t.plain for t in of) / sum(t.maps for t in of))
        parts.append(f"{split}: {share} % generalised, {len(over)} of {len(of)} types above the goal")
    goal = f"At most {GOAL:.0%} of a routing type's test maps are to be from the generalised extract. "
    reason = (
        ". A build tries the tagged maps of a stratum first and takes a generalised one where no more of them pass. "
        "Most of those passed over have an obedient way that takes too long; the table of quotas counts the reasons"
    )
    return goal + "Routing types, " + "; ".join(parts) + reason if parts else ""


def dataset_page(tables: Sequence[Analysis], folder: str) -> str:
    """The page docs/dataset.md: the test split of the first table, and what stands in the files of all in `folder`."""
    head = "# The data set in figures\n\nMade by `tsbench scenarios stats --markdown docs/dataset.md`.\n"
    first, *others = tables
    keys = [column.key for column in first.table.columns]
    shown = [keys.index(key) for key in _SHOWN]
    rows = tuple(
        Row(tuple(row.cells[k] for k in shown)) for row in first.table.rows if row.cells[keys.index("split")] == "test"
    )
    test = Table(tuple(first.table.columns[k] for k in shown), rows, 1)
    parts = [head, to_markdown(replace(first, table=test))]
    parts.append(f"The table shows the test split. All splits and shares: {_link(first, folder)}.\n\n## More tables\n")
    for analysis in others:
        columns = ", ".join(column.head for column in analysis.table.columns)
        notes = "".join(f" {note.removesuffix('.')}." for note in analysis.notes if note)
        parts.append(f"* {_link(analysis, folder)}: **{analysis.title}.** Columns: {columns}.{notes}")
    return "\n".join(parts) + "\n"


def _link(analysis: Analysis, folder: str) -> str:
    return f"[`{folder}/{analysis.name}.csv`]({folder}/{analysis.name}.csv)"


def _percent(share: float) -> str:
    """Whole only where it is whole: 99.96 % is not 100 %."""
    return f"{100 * share:.0f}" if share in (0.0, 1.0) else f"{min(100 * share, 99.9):.1f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{k} {v}" for k, v in counts.items()) or "none"


def _reasons(reasons: Mapping[str, int]) -> str:
    return "; ".join(f"{n} {shown_reason(why)}" for why, n in reasons.items()) or "none"


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
    target = next(sign for sign in layout.signs if sign.id == layout.target)
    others = sorted((sign.code, sign.value, sign.edge) for sign in layout.signs if sign.role == DISTRACTOR)
    return Asked((target.code, target.value), target.edge, tuple(others), layout.start.lane, layout.destination.edge)


def type_axes(data: DataSet, specs: Sequence[ScenarioSpec], progress: Progress) -> dict[tuple[str, str], Axes]:
    """One entry per type and split, in alphabetical order. Reads each signed row's scene. Raises InputError."""
    loader = SceneLoader(data)
    # Rows of a map one after the other: the store unpacks a map at a time.
    signed = sorted((s for s in specs if s.half == SIGNED), key=lambda s: (s.split, s.pair_type, s.map_id, s.variant))
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
