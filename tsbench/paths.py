"""Where the data lives: the clone's root, or the folder named by TSBENCH_DATA."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from tsbench.errors import InputError


@cache
def data_root() -> Path:
    """The folder that holds `sign_catalog/`, `sumo_nets/` and `scenarios/`.

    TSBENCH_DATA wins; otherwise the clone that this package is installed from (`pip install -e .`).
    """
    named = os.environ.get("TSBENCH_DATA")
    root = Path(named) if named else Path(__file__).resolve().parent.parent
    if not (root / "sign_catalog").is_dir():
        hint = "TSBENCH_DATA" if named else "set TSBENCH_DATA to a clone of the repository"
        raise InputError(f"{root}: no sign_catalog/ here ({hint})")
    return root


def fetch_hint(part: str) -> str:
    """The words that say how to get a part of the data that does not come with the package."""
    return f"tsbench data fetch --from DIR|URL {part}"
