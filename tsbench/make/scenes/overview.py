"""Figures about the scenario tables: what there is, where, and how evenly; and tables of them."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from statistics import median
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.textfile import read_json
from tsbench.make.city import City
from tsbench.make.scenes.recipe import Recipe, stratum_of
from tsbench.make.scenes.split import places_of, split_pool
from tsbench.report.analyses.analysis import Analysis, Row, Table
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns
from tsbench.scenarios.certificates import certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import PoolRow, read_pool
from tsbench.scenarios.spec import SIGNED, ScenarioSpec

_SHARES = ("solvable", "tempting", "engaged", "sane")


@dataclass(frozen=True)
class TypeStats:
    """Rows, pairs, maps and places of a type in one split; maps by stratum; share of maps from tagged extracts.

    The rest are shares of signed rows after their certificates, reproduced of all rows; gap_s the median of |arrival
    gap| (NaN without one), seen the share of pairs whose halves look different before the ego's line.
    """

    type_id: str
    split: str
    rows: int
    pairs: int
    maps: int
    places: int
    strata: dict[str, int]
    tagged_share: float
    solvable: float
    tempting: float
    engaged: float
    sane: float
    reproduced: float
    gap_s: float
    seen: float


def report_file(data: DataSet) -> Path:
    return data.file("scenarios/build_report.json")


def build_report(path: Path) -> list[dict[str, Any]]:
    """What the last build of each type and split wrote down (build.TypeReport). Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: no build report (tsbench scenarios build makes it)")
    report: list[dict[str, Any]] = read_json(path, "build report")
    wanted = {"type_id": str, "split": str}
    for entry in report if isinstance(report, list) else [None]:
        if not isinstance(entry, dict) or any(not isinstance(entry.get(k), v) for k, v in wanted.items()):
            raise InputError(f"{path}: not a build report (expected a list of reports on types)")
    return report


def type_stats(data: DataSet, specs: Sequence[ScenarioSpec]) -> list[TypeStats]:
    """One entry per type and split, in alphabetical order. A row without a certificate proves nothing."""
    pool = {r.map_id: r for r in read_pool(data.pool_path)}
    known = {c.scenario_id: c for c in certificates_of(data)}
    groups: dict[tuple[str, str], list[ScenarioSpec]] = defaultdict(list)
    for spec in specs:
        groups[(spec.pair_type, spec.split)].append(spec)
    place = {
        split: places_of([pool[m] for m in {s.map_id for s in specs if s.split == split}])
        for split in {s.split for s in specs}
    }
    result = []
    for (type_id, split), rows in sorted(groups.items()):
        maps = [pool[m] for m in sorted({r.map_id for r in rows})]
        signed = [r for r in rows if r.half == SIGNED]
        proofs = [known[r.scenario_id] for r in signed if r.scenario_id in known]
        gaps = [abs(c.arrival_gap_s) for c in proofs if not math.isnan(c.arrival_gap_s)]
        n, pairs = len(signed), sum(bool(r.pair_id) for r in signed)
        result.append(
            TypeStats(
                type_id=type_id,
                split=split,
                rows=len(rows),
                pairs=pairs,
                maps=len(maps),
                places=len({place[split][m.map_id] for m in maps}),
                strata=dict(sorted(Counter(stratum_of(m) for m in maps).items())),
                tagged_share=sum(m.well_tagged for m in maps) / len(maps),
                **{name: sum(getattr(c, name) for c in proofs) / n if n else math.nan for name in _SHARES},
                reproduced=sum(r.scenario_id in known and known[r.scenario_id].reproduced is True for r in rows)
                / len(rows),
                gap_s=median(gaps) if gaps else math.nan,
                seen=sum(c.differs_s is not None for c in proofs) / pairs if pairs else math.nan,
            )
        )
    return result


def shown_reason(reason: str) -> str:
    """A reason as it is counted, for readers: "…" stands for numbers and names, which differ from map to map."""
    return " ".join("…" if word == "#" else word for word in reason.split(" "))


@dataclass(frozen=True)
class Carried:
    """A type in a split. there: maps of its family and strata. maps: built ones, of so many wanted. why: not more."""

    type_id: str
    split: str
    there: int
    maps: int
    wanted: int
    why: str


def carried(
    city: City, pool: Sequence[PoolRow], recipes: Sequence[Recipe], report: Sequence[dict[str, Any]]
) -> list[Carried]:
    """One entry for each type and split of the city. report: what its last build wrote down, () before the first."""
    split_of = split_pool(pool, city.split)
    built = {(entry["type_id"], entry["split"]): entry for entry in report}
    found = []
    for recipe in recipes:
        for split, most in city.maps.items():
            there = sum(
                row.family == recipe.type.family and split_of[row.map_id] == split and stratum_of(row) in recipe.maps
                for row in pool
            )
            entry = built.get((recipe.type.id, split))
            maps = sum(entry["maps"].values()) if entry else 0
            why = "" if maps >= most else _why(recipe, there, entry)
            found.append(Carried(recipe.type.id, split, there, maps, most, why))
    return found


def _why(recipe: Recipe, there: int, entry: dict[str, Any] | None) -> str:
    if not there:
        return f"no {recipe.type.family.replace('_', ' ')} of {', '.join(recipe.maps)} in its tiles"
    if entry is None:
        return "not built yet"
    reasons = [f"{count} {shown_reason(reason)}" for reason, count in entry["reasons"].items()]
    return "; ".join(reasons) or "the maps lie too near to each other"


_SHOWN = {"tagged": "tagged_share", **{name: name for name in _SHARES}, "again": "reproduced"}


def dataset_tables(stats: Sequence[TypeStats], report: Sequence[Mapping[str, Any]]) -> tuple[Analysis, Analysis]:
    """Rows, and maps. report: what the last build wrote down (overview.build_report)."""
    splits = dict.fromkeys(t.split for t in stats)
    counts = {split: sum(t.rows for t in stats if t.split == split) for split in splits}
    by_split = ", ".join(f"{split} {count:,}" for split, count in counts.items())
    rows = []
    for t in stats:
        shares = (percent(getattr(t, name)) for name in _SHOWN.values())
        gap, seen = None if isnan(t.gap_s) else t.gap_s, "" if isnan(t.seen) else percent(t.seen)
        rows.append(Row((t.type_id, t.split, t.rows, t.pairs, t.maps, t.places, *shares, gap, seen)))
    columns = (
        *text_columns("type", "split"),
        *count_columns("rows", "pairs", "maps", "places"),
        *text_columns(*_SHOWN),
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


def percent(share: float) -> str:
    """Whole only where it is whole: 99.96 % is not 100 %."""
    return f"{100 * share:.0f}" if share in (0.0, 1.0) else f"{min(100 * share, 99.9):.1f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{k} {v}" for k, v in counts.items()) or "none"


def _reasons(reasons: Mapping[str, int]) -> str:
    return "; ".join(f"{n} {shown_reason(why)}" for why, n in reasons.items()) or "none"
