"""One pair of each test map in the mirror (`make mirrored`): as `test_mirror.py`, on ten times the scenes."""

from __future__ import annotations

import pytest
from drives_in_mirror import compared

from tsbench.run.plan import choose_variants
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog


@pytest.mark.whole
@pytest.mark.parametrize("name", ["idm-e", "idm"])
@pytest.mark.parametrize("type_id", [kind.id for kind in load_catalog().types])
def test_a_drive_in_the_mirror_is_the_drive(type_id: str, name: str) -> None:
    rows = choose_variants(DataSet().table("test"), "one-per-map")
    of = [row for row in rows if row.pair_type == type_id]
    assert len({row.map_id for row in of}) == 20
    for row in of:
        compared(row, name)
    print(f"{type_id}, {name}: {len(of)} drives and their images agree tick by tick")
