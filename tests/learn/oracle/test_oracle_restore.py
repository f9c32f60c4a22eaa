"""A collection from the tables that were chosen from it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from oracle_helpers import collection, line

from tsbench.core.errors import InputError
from tsbench.learn.oracle.restore import restore
from tsbench.learn.oracle.select import select
from tsbench.scenarios.spec import ScenarioSpec


def test_a_collection_begins_again_from_its_tables(full: Path, rows: list[ScenarioSpec]) -> None:
    """Other experts may be added; what was there is chosen from again, to the same bytes."""
    made = full / "made"
    select(full / "c", made / "oracle.parquet", allow_partial=False)
    assert {path.name for path in made.iterdir()} == {"oracle.parquet", "oracle_tries.parquet", "oracle.json"}
    assert restore(made / "oracle.parquet", full / "again") == 9
    with closing(collection(full / "again", rows[:3])) as again:
        assert again.notices == []
        assert len(again.journal.done) == 9
        again.end(complete=True)
    assert (full / "again" / "tries.parquet").read_bytes() == (made / "oracle_tries.parquet").read_bytes()
    select(full / "again", full / "oracle.parquet", allow_partial=False)
    assert (full / "oracle.parquet").read_bytes() == (made / "oracle.parquet").read_bytes()


@pytest.mark.parametrize("what", ["full", "tries", "manifest", "other tries"])
def test_restore_refuses_in_one_line(full: Path, rows: list[ScenarioSpec], what: str) -> None:
    """A folder that is in use, and tables that are not all there or not of one collection."""
    table, folder = full / "oracle.parquet", full / "again"
    select(full / "c", table, allow_partial=False)
    told = "no such table"
    if what == "full":
        folder, told = full / "c", "is not empty"
    elif what == "tries":
        (full / "oracle_tries.parquet").unlink()
    elif what == "manifest":
        (full / "oracle.json").unlink()
        told = r"oracle.json: no collection \(tsbench oracle select writes its manifest\)"
    else:
        with closing(collection(full / "other", rows[:1])) as made:
            made.keep(line("net-e", rows[0], 101))
            made.end(complete=True)
        (full / "oracle_tries.parquet").write_bytes((full / "other" / "tries.parquet").read_bytes())
        told = "net-e: its tries are of another collection"
    with pytest.raises(InputError, match=told):
        restore(table, folder)
