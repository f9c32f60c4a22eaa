"""What the floor `codes` knows: in which halves of train's pairs each plate stands. Source: docs/floor.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from tsbench.core.files import write_atomic
from tsbench.planners.floor.codes import Plate
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec


def plates_of(row: ScenarioSpec, loader: SceneLoader) -> tuple[Plate, ...]:
    """Code and value of every plate of a row's scene, one entry a plate."""
    return tuple((sign.code, sign.value) for sign in loader.layout(row)[1].signs)


def count(rows: Iterable[ScenarioSpec]) -> dict[Plate, tuple[int, int]]:
    """Signed and contrast halves in which a plate stands, of rows that have a pair."""
    loader = SceneLoader(DataSet.in_use())
    there: dict[str, Counter[Plate]] = {SIGNED: Counter(), CONTRAST: Counter()}
    for row in rows:
        if row.pair_id:
            there[row.half].update(set(plates_of(row, loader)))
    every = sorted({*there[SIGNED], *there[CONTRAST]}, key=lambda plate: (plate[0], plate[1] or 0.0))
    return {plate: (there[SIGNED][plate], there[CONTRAST][plate]) for plate in every}


def write_counts(counted: Mapping[Plate, tuple[int, int]], path: Path) -> None:
    """The file that the planner reads: code, value (km/h, empty for none), signed, contrast."""
    lines = [
        f"{code},{'' if value is None else f'{value:g}'},{signed},{contrast}"
        for (code, value), (signed, contrast) in counted.items()
    ]
    write_atomic(path, "\n".join(["code,value,signed,contrast", *lines, ""]).encode("ascii"))
