"""A data folder with scenarios that need no SUMO, and the command line on it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from run_helpers import ROOT, Bench, specs

from tsbench.scenarios.data_set import write_table
from tsbench.scenarios.map_pool import POOL_SCHEMA
from tsbench.scenarios.store import store_path, write_store


def write_data(root: Path, maps: int = 2) -> Path:
    """Scenarios of two types, ten on each map of a type."""
    root.mkdir(parents=True)
    (root / "sign_catalog").symlink_to(ROOT / "sign_catalog")
    rows = specs(maps)
    for kind in {row.scenario_type for row in rows}:
        scenes: dict[str, dict[str, bytes]] = defaultdict(dict)
        for row in rows:
            if row.scenario_type == kind:
                scenes[row.map_id] |= {row.net: b"", row.additional: b""}
        write_store(scenes.items(), store_path("test", kind, root / "scenarios"))
    write_table(rows, root / "scenarios" / "test.parquet")
    (root / "sumo_nets").mkdir()
    pool = pa.table({"map_id": sorted({row.map_id for row in rows})})
    pool = pool.replace_schema_metadata(POOL_SCHEMA.metadata)
    pq.write_table(pool, root / "sumo_nets" / "pool.parquet")
    return root


@pytest.fixture(scope="session")
def make_data() -> Callable[..., Path]:
    return write_data


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_data(tmp_path / "data")


@pytest.fixture
def bench(data: Path, tmp_path: Path) -> Bench:
    return Bench(data, tmp_path)
