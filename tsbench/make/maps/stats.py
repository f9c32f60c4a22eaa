"""Counts of the pool, as plain tables and as a map of the city with every crop as a dot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.make.city import by_preference, extract_info, load_city
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import FAMILIES, SLOTS, PoolRow

# drawn in this order: the many first
COLOURS = {"corridor": "#8c959f", "junction": "#1f6feb", "dual_path": "#2da44e", "roundabout": "#d1242f"}
ATTRIBUTION = "© OpenStreetMap contributors, ODbL 1.0"
_LENGTHS = ("150-174 m", "175-199 m", "200-224 m", "225-250 m")
_CURVES = ("0.970-0.979", "0.980-0.989", "0.990-0.999", "1.000")


@dataclass(frozen=True)
class CountTable:
    """A table of counts: `rows` of (name, count per column); every row sums over the maps that it names."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[int, ...]], ...]


def count_tables(data: DataSet, pool: Sequence[PoolRow]) -> list[CountTable]:
    code_of = {name: extract_info(data, name).code for name in by_preference(data, sorted({r.source for r in pool}))}
    corridors = [row for row in pool if row.family == "corridor"]
    dual = [row for row in pool if row.family == "dual_path"]
    return [
        _table("Maps by family and shape", pool, _kind, list(code_of.values()), lambda row: code_of[row.source]),
        _table("Dual paths by slot", dual, lambda row: row.slot, ["T", "X"], lambda row: row.shape, SLOTS),
        _table("Dual paths by slot, well tagged", dual, lambda row: row.slot, ["yes", "no"], _tagged, SLOTS),
        _table("Corridors by shape, direction and lanes", corridors, _corridor_kind, ["1", "2", "3+"], _bucket),
        _table(
            "Corridors of well-tagged extracts",
            [row for row in corridors if row.well_tagged],
            _corridor_kind,
            ["1", "2", "3+"],
            _bucket,
        ),
        _table("Lanes per direction", pool, lambda row: row.family, ["1", "2", "3+"], _bucket, FAMILIES),
        _table("Corridor length", corridors, lambda row: row.shape, list(_LENGTHS), _length_bin),
        _table("Corridor chord over arc", corridors, lambda row: row.shape, list(_CURVES), _curve_bin),
    ]


def _kind(row: PoolRow) -> str:
    return f"{row.family} {row.shape}"


def _corridor_kind(row: PoolRow) -> str:
    return f"{row.shape}, {'one-way' if row.oneway else 'two-way'}"


def _tagged(row: PoolRow) -> str:
    return "yes" if row.well_tagged else "no"


def _bucket(row: PoolRow) -> str:
    return "3+" if row.lane_bucket == 3 else str(row.lane_bucket)


def _length_bin(row: PoolRow) -> str:
    return _LENGTHS[min(max(int((row.length_m - 150) // 25), 0), 3)]


def _curve_bin(row: PoolRow) -> str:
    return _CURVES[min(max(int((row.curvature - 0.97) / 0.01 + 1e-9), 0), 3)]


def _table(
    title: str,
    pool: Sequence[PoolRow],
    name: Callable[[PoolRow], str],
    columns: Sequence[str],
    column: Callable[[PoolRow], str],
    names: Sequence[str] = (),
) -> CountTable:
    counts = Counter((name(row), column(row)) for row in pool)
    ordered = list(names) or sorted({key for key, _ in counts})
    rows = [(key, tuple(counts[key, col] for col in columns)) for key in ordered]
    rows.append(
        ("all", tuple(sum(values) for values in zip(*(v for _, v in rows), strict=True)) or (0,) * len(columns))
    )
    return CountTable(title, (*columns, "sum"), tuple((key, (*values, sum(values))) for key, values in rows))


def draw_pool(data: DataSet, pool: Sequence[PoolRow], png: Path) -> None:
    """A map of the pool: one dot per crop, coloured by family; kilometres in the city's frame."""
    from matplotlib.figure import Figure  # counts need no picture

    figure = Figure(figsize=(11, 11), layout="constrained")
    axis = figure.add_subplot()
    frame = load_city(data.name).frame
    for family, colour in COLOURS.items():
        members = [row for row in pool if row.family == family]
        east, north = ([frame.true_east(row.east) / 1000 for row in members], [row.north / 1000 for row in members])
        label = f"{family.replace('_', ' ')} ({len(members):,})"
        axis.scatter(east, north, s=14 if family == "roundabout" else 2, c=colour, linewidths=0, label=label)
    axis.set_aspect("equal")
    axis.set_xlabel(f"east, km ({replace(frame, mirrored=False)})")
    axis.set_ylabel("north, km")
    axis.set_title(f"{len(pool):,} maps")
    axis.legend(markerscale=3, loc="upper right")
    axis.text(0.99, 0.01, ATTRIBUTION, transform=axis.transAxes, ha="right", fontsize=8)
    with io_errors_as_input_errors(png), replacing(png) as part:
        figure.savefig(part, format="png", dpi=110, metadata={"Software": None})
