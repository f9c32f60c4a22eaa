"""Rows that a training writes as it goes, a line of JSON each: what its curve is drawn from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from tsbench.core.files import write_atomic

Row = Mapping[str, float]


def add_row(path: Path, row: Row, key: str) -> None:
    """Put a row behind those with a smaller `key`.

    Others go: a training that was broken off wrote them after its last checkpoint.
    """
    kept = [one for one in read_rows(path) if one[key] < row[key]]
    write_atomic(path, "".join(json.dumps(one) + "\n" for one in [*kept, row]).encode())


def read_rows(path: Path) -> list[Row]:
    """The rows of a file; none without a file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]
