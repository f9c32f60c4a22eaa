"""Scenario tables: what goes in comes out, and what is broken is said in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import one_line
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tsbench.core.benchmark import MAPS
from tsbench.core.errors import InputError
from tsbench.scenarios.data_set import SPLITS, read_table, write_table
from tsbench.scenarios.spec import ScenarioSpec

BASE = ScenarioSpec(
    "yield-j-1-v0", "yield", "priority", "2.4", None, "j-1", "junction", "T", "", 0, "test", 2**32 - 1, 7.75, 90.0,
    4.0, 2, 5, 600, "scenes/yield/j-1/net.net.xml.gz", "scenes/yield/j-1/v0.add.xml.gz", "a" * 64, "b" * 64,
)  # fmt: skip


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "t.parquet"


def rows(n: int) -> list[ScenarioSpec]:
    return [replace(BASE, scenario_id=f"yield-j-1-v{k}", variant=k, seed=k) for k in range(n)]


SPECS = st.lists(
    st.builds(
        replace,
        st.just(BASE),
        scenario_id=st.text(st.characters(categories=("L", "N", "P")), min_size=1, max_size=12),
        sign_value=st.none() | st.floats(5, 110),
        seed=st.integers(0, 2**32 - 1),
        initial_speed=st.floats(0, 22),
        density=st.sampled_from([0.0, 2.3333, 5.5]),
        drivers=st.integers(-1, 2),
        horizon=st.integers(1, 10_000),
        split=st.sampled_from(["train", "test"]),
    ),
    max_size=8,
    unique_by=lambda s: s.scenario_id,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(SPECS)
def test_round_trip_sorted_by_id(path: Path, specs: list[ScenarioSpec]) -> None:
    write_table(specs, path)
    assert read_table(path) == sorted(specs, key=lambda s: s.scenario_id)
    assert list(path.parent.iterdir()) == [path]


def refuse(path: Path) -> str:
    with one_line(str(path)) as said:
        read_table(path)
    return said[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"split": "exam"}, "row 1 (yield-j-1-v1): unknown split 'exam'"),
        ({"horizon": 0}, "horizon 0"),
        ({"horizon": 10_001}, "horizon 10001"),
        ({"initial_speed": -1.0}, "initial speed -1.0"),
        ({"initial_speed": float("nan")}, "initial speed nan"),
        ({"scenario_id": "yield-j-1-v0"}, "the id occurs twice"),
        ({"net": "../outside.net.xml"}, "outside the data folder"),
        ({"scenario_type": "../../yield"}, "outside the data folder"),
        ({"net": "/etc/passwd"}, "outside the data folder"),
        ({"additional": "scenes/../../x.add.xml"}, "outside the data folder"),
    ],
)
def test_a_row_that_cannot_be(path: Path, change: dict[str, object], words: str) -> None:
    bad = rows(3)
    bad[1] = replace(bad[1], **change)  # type: ignore[arg-type]
    write_table(bad, path)
    assert words in refuse(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace_schema_metadata({"tsbench_schema": "7"}), "schema version 7, this tsbench reads 1"),
        (lambda t: t.replace_schema_metadata(None), "schema version none"),
        (lambda t: t.drop_columns(["net_sha256"]), "column 'net_sha256' is missing"),
        (lambda t: t.set_column(t.schema.get_field_index("horizon"), "horizon", [["many", "few", "none"]]), ""),
        (lambda t: t.set_column(t.schema.get_field_index("split"), "split", [["test", None, "test"]]), ""),
    ],
)
def test_a_table_that_is_not_of_rows(path: Path, change: Callable[[pa.Table], pa.Table], words: str) -> None:
    write_table(rows(3), path)
    pq.write_table(change(pq.ParquetFile(path).read()), path)
    assert words in refuse(path)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_flipped_bytes_are_never_a_traceback(path: Path, share: float) -> None:
    write_table(rows(10), path)
    data = bytearray(path.read_bytes())
    at = int(len(data) * share)
    data[at : at + 16] = bytes(255 - b for b in data[at : at + 16])
    path.write_bytes(data)
    told = ""
    try:
        read_table(path)
    except InputError as error:
        told = str(error)
    assert "\n" not in told


def pair(number: int) -> list[ScenarioSpec]:
    name = f"yield-j-1-v{number}"
    signed = replace(BASE, scenario_id=name, variant=number, pair_id=name)
    return [signed, replace(signed, scenario_id=f"{name}-c", half="contrast", scenario_type="main_road")]


def test_halves_of_a_pair_are_neighbours_and_come_back(path: Path) -> None:
    write_table([*pair(1), *reversed(pair(0))], path)
    assert read_table(path) == [*pair(0), *pair(1)]
    assert {r.pair_type for r in read_table(path)} == {"yield"}


def test_a_table_from_before_pairs_has_signed_rows_only(path: Path) -> None:
    write_table(rows(3), path)
    table = pq.read_table(path)
    assert table["pair_id"].null_count == 3
    pq.write_table(table.drop_columns(["pair_id", "half", "place"]), path)
    assert read_table(path) == rows(3)


def test_the_place_of_a_map_comes_back(path: Path) -> None:
    write_table([replace(BASE, place="p-j-1")], path)
    assert [row.place for row in read_table(path)] == ["p-j-1"]


@pytest.mark.parametrize("wrong", [{"half": "other"}, {"half": "contrast"}, {"pair_id": "yield-j-2-v0"}])
def test_a_half_that_contradicts_its_pair_is_an_error(path: Path, wrong: dict[str, str]) -> None:
    write_table([replace(BASE, **wrong)], path)
    with pytest.raises(InputError, match="is impossible"):
        read_table(path)


def test_the_splits_are_those_of_the_benchmark() -> None:
    assert tuple(MAPS) == SPLITS
