"""Draws scenes and driven episodes on sheets, both halves of a pair side by side, to be looked at.

python packaging/contact_sheets.py OUT [--split dev] [--pairs 20] [--run RUN]

OUT gets `types-N.png`: of each type the first nominal pair, from RUN the moments at which a rule is broken (or
half-way), without RUN the scenes at their start; and `GROUP-N.png`: so many pairs of each group at their start, over
all its types.
TSBENCH_CITY chooses the city.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

import cv2
import numpy as np

from tsbench.report.drawing.canvas import STYLE, Image, PageSize
from tsbench.report.drawing.paint import save_png, sheet
from tsbench.report.scene_pictures import PNG_SIZE, moment, scene_picture
from tsbench.run.log.read import read_run
from tsbench.run.run_traces import Traces
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec

_COLUMNS, _ROWS = 4, 5
_VIEW = PageSize(480, 440)
Panel = tuple[str, Image]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--split", default="dev")
    parser.add_argument("--pairs", type=int, default=20, help="of each group")
    parser.add_argument("--run", type=Path, help="a run of one planner with --trace all")
    asked = parser.parse_args()
    pairs = pairs_of(DataSet.driven().table(asked.split))
    first = {signed.pair_type: (signed, other) for signed, other in reversed(pairs) if signed.variant == 0}
    _save(asked.out, "types", [first[name] for name in sorted(first)], asked.run)
    groups = defaultdict(list)
    for pair in pairs:
        groups[pair[0].group].append(pair)
    for group, found in sorted(groups.items()):
        _save(asked.out, group, spread(found, asked.pairs), None)


def pairs_of(rows: Sequence[ScenarioSpec]) -> list[tuple[ScenarioSpec, ScenarioSpec | None]]:
    """Each signed half with its contrast half, None where it has none."""
    others = {row.pair_id: row for row in rows if row.half == CONTRAST}
    return [(row, others.get(row.pair_id) if row.pair_id else None) for row in rows if row.half != CONTRAST]


def spread(
    pairs: Sequence[tuple[ScenarioSpec, ScenarioSpec | None]], count: int
) -> list[tuple[ScenarioSpec, ScenarioSpec | None]]:
    """So many of them, types in turn, maps of a type as far apart in the table as there are."""
    types = defaultdict(list)
    for pair in pairs:
        types[pair[0].scenario_type].append(pair)
    share = -(-count // len(types))
    chosen = [found[:: max(len(found) // share, 1)] for found in types.values()]
    return [pair for turn in zip_longest(*chosen) for pair in turn if pair is not None][:count]


def _save(out: Path, name: str, pairs: Sequence[tuple[ScenarioSpec, ScenarioSpec | None]], run: Path | None) -> None:
    panels = list(_panels(pairs, run))
    size = _COLUMNS * _ROWS
    for number, begin in enumerate(range(0, len(panels), size), 1):
        path = out / f"{name}-{number}.png"
        save_png(path, sheet(panels[begin : begin + size], _COLUMNS))
        print(path)


def _panels(pairs: Sequence[tuple[ScenarioSpec, ScenarioSpec | None]], run: Path | None) -> Iterator[Panel]:
    for signed, other in pairs:
        yield _panel(signed, other, run)
        if other is not None:
            yield _panel(other, signed, run)
        else:
            yield f"{signed.scenario_type}\nno contrast half", np.full(_shape(), STYLE.panel, dtype=np.uint8)


def _panel(row: ScenarioSpec, other: ScenarioSpec | None, run: Path | None) -> Panel:
    scene, text = load_scene(DataSet.driven(), row), f"{row.scenario_id}\nsign {row.sign_code} {row.half}"
    if run is None:
        beside = None if other is None else load_scene(DataSet.driven(), other)
        page = scene_picture(scene, row.scenario_id, _VIEW, map_id=row.map_id, beside=beside)
        return text, np.ascontiguousarray(page[_VIEW.header_px : -_VIEW.footer_px])
    traces = Traces(read_run(run))
    trace = traces.read(traces.run.row(row.scenario_id)["planner"], row.scenario_id)
    page = moment(trace, scene)[PNG_SIZE.header_px : -PNG_SIZE.footer_px]
    height, width, _ = _shape()
    return f"{text} · {trace.outcome}", cv2.resize(page, (width, height), interpolation=cv2.INTER_AREA)


def _shape() -> tuple[int, int, int]:
    return _VIEW.view_height, _VIEW.width, 3


if __name__ == "__main__":
    main()
