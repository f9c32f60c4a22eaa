"""The harvest's progress on disk: one file per finished step, named after all that it depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tsbench.core.paths import data_file
from tsbench.dataset.maps.osm import sha256_of
from tsbench.dataset.maps.paths import build_dir, netconvert_file
from tsbench.scenarios.map_pool import PoolRow


def harvest_key(extracts: Sequence[Path]) -> str:
    """A digest of extracts, configurations and this package's code: other inputs, another folder."""
    inputs = [*extracts, data_file("sumo_nets/harvest.yaml")]
    inputs += [netconvert_file(name) for name in ("extract.netccfg", "crop.netccfg", "moscow.typ.xml")]
    inputs += sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.blake2b(digest_size=8)
    for path in inputs:
        digest.update(f"{path.name} {sha256_of(path)}\n".encode())
    return digest.hexdigest()


def harvest_dir(key: str) -> Path:
    """Where the steps of one harvest are kept."""
    return build_dir() / "harvest" / key


def batch_name(source: str, family: str, rows: Sequence[PoolRow]) -> str:
    """The file name of a linted batch."""
    digest = hashlib.blake2b("\n".join(row.map_id + row.detail for row in rows).encode(), digest_size=8)
    return f"lint-{source}-{family}-{digest.hexdigest()}.json"


def write_json(path: Path, content: Any) -> None:
    """Write JSON so that a reader never sees half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_name(path.name + ".part")
    half.write_text(
        json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    half.replace(path)


def read_json(path: Path) -> Any:
    """What `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))
