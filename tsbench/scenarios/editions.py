"""Which edition the scenes of each split are of: `scenarios/editions.yaml`.

A split that is not rebuilt yet stays what it was: scenes of an earlier edition, proven under that one's rules.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from tsbench.core.files import write_atomic
from tsbench.core.paths import dataset_file, dataset_root
from tsbench.core.typed import read_typed
from tsbench.scenarios.table import SplitName


def scene_editions(root: Path | None = None) -> dict[str, str]:
    """By split, of those that the file names; {} without a file. Raises InputError for anything else in it."""
    path = dataset_file("scenarios/editions.yaml") if root is None else root / "editions.yaml"
    if not path.is_file():
        return {}
    found = read_typed(dict[SplitName, str], path, "list of editions")
    return {str(split): edition for split, edition in found.items()}


def write_scene_editions(scenes: Mapping[str, str]) -> None:
    """Write the edition of each split of the data in use down."""
    write_atomic(dataset_root() / "scenarios" / "editions.yaml", yaml.safe_dump(dict(scenes)).encode())
