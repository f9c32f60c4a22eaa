"""Stores of scene files: what is written is read, the same bytes each time; what is broken or too large is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import one_line
from episode_builders import spec
from hypothesis import given
from hypothesis import strategies as st
from simworld import SceneMaker, plate, store_scenes

from tsbench.core.errors import InputError
from tsbench.core.xmlfile import sha256
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios import store as store_module
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import MOST_BYTES, SCHEMA, SceneStore, store_path, write_store
from tsbench.sim.scene import EgoStart

NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=12)
MAPS = st.dictionaries(NAMES, st.dictionaries(NAMES, st.binary(max_size=300), min_size=1, max_size=5), max_size=7)


@pytest.fixture
def made(on_block: SceneMaker, tmp_path: Path) -> ScenarioSpec:
    """A row whose files stand in a store below `tmp_path`."""
    sign = plate(on_block.network, "ta", 139.0)
    way = ("ta", "ab", "bu")
    spec = on_block.make("stored", EgoStart("ta_0", 60.0, 8.0), Destination("bu", 60.0), way, sign)
    store_scenes([spec], on_block.root, tmp_path)
    return spec


def rewrite(root: Path, spec: ScenarioSpec, change: dict[str, list[Any]], **options: Any) -> Path:
    """The row's store with other columns, by name."""
    path = store_path(spec.split, spec.scenario_type, root)
    columns = pq.read_table(path).to_pydict() | change
    plain: dict[str, Any] = {"use_dictionary": False, "write_statistics": ["map_id"]}
    pq.write_table(pa.Table.from_pydict(columns, schema=SCHEMA), path, **plain, **options)
    return path


def refuse(root: Path, spec: ScenarioSpec) -> str:
    with one_line() as said:
        SceneLoader(DataSet(), SceneStore(root)).load(spec)
    return said[0]


@given(maps=MAPS)
def test_what_is_written_is_read_and_always_the_same_bytes(
    maps: dict[str, dict[str, bytes]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    root = tmp_path_factory.mktemp("store")
    path = store_path("test", "yield", root)
    write_store(maps.items(), path)
    first = path.read_bytes()
    turned = {m: dict(reversed(files.items())) for m, files in reversed(maps.items())}
    write_store(turned.items(), path)
    assert path.read_bytes() == first
    store = SceneStore(root)
    for map_id, files in maps.items():
        row = spec_of(map_id)
        assert {name: store.read(row, name).content for name in files} == files
        with pytest.raises(InputError, match="no such scene file"):
            store.read(row, "\0")
    assert store.names("test", "yield") == {n: sha256(c) for files in maps.values() for n, c in files.items()}


def spec_of(map_id: str) -> ScenarioSpec:
    return replace(spec("one"), scenario_type="yield", map_id=map_id)


def test_a_row_group_for_each_map_and_where_it_comes_from(tmp_path: Path) -> None:
    path = store_path("train", "yield", tmp_path)
    write_store([("b", {"n": b"2"}), ("a", {"n": b"0", "m": b"1"})], path)
    file = pq.ParquetFile(path)
    assert [file.read_row_group(k)["map_id"].to_pylist() for k in range(2)] == [["a", "a"], ["b"]]
    told = file.schema_arrow.metadata
    assert told == {b"tsbench_schema": b"1", b"licence": "ODbL 1.0, © OpenStreetMap contributors".encode()}
    assert pa.__version__ in file.metadata.created_by


def test_a_scene_is_loaded_from_its_store(
    made: ScenarioSpec, on_block: SceneMaker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loader = SceneLoader(DataSet(), SceneStore(tmp_path))
    scene, roads = loader.load(made)
    assert scene.start == EgoStart("ta_0", 60.0, 8.0)
    assert str(scene.additional) == str(store_path("test", "yield", tmp_path) / made.additional)
    # Rows of one map: nothing is unpacked or parsed twice.
    monkeypatch.setattr(store_module._Opened, "table", None)
    assert loader.load(replace(made, scenario_id="two"))[1] is roads
    assert on_block.root != tmp_path


def test_a_store_that_is_not_there(made: ScenarioSpec, tmp_path: Path) -> None:
    text = refuse(tmp_path, replace(made, split="train"))
    path = store_path("train", "yield", tmp_path)
    assert text == f"{path}: no such scene files (tsbench data fetch --from DIR|URL train)"


def test_a_map_and_a_file_that_a_store_does_not_have(made: ScenarioSpec, tmp_path: Path) -> None:
    path = store_path("test", "yield", tmp_path)
    assert refuse(tmp_path, replace(made, map_id="gone")).endswith(f"{path / made.additional}: no such scene file")
    assert refuse(tmp_path, replace(made, net="gone")).endswith(f"{path / 'gone'}: no such scene file")


def test_changed_content_and_a_size_that_is_not_so(made: ScenarioSpec, tmp_path: Path) -> None:
    path = store_path("test", "yield", tmp_path)
    table = pq.read_table(path).to_pydict()
    place = table["name"].index(made.additional)
    contents = [c.replace(b"13.89", b"13.98") for c in table["content"]]
    rewrite(tmp_path, made, {"content": contents})
    assert refuse(tmp_path, made) == f"{path / made.net}: is not the file that row stored names (SHA-256 differs)"
    sizes = [n + (k == place) for k, n in enumerate(table["size"])]
    rewrite(tmp_path, made, {"content": table["content"], "size": sizes})
    told = f"has {sizes[place] - 1} bytes, not the {sizes[place]} that it says"
    assert refuse(tmp_path, made) == f"{path / made.additional}: {told}"


def test_what_would_unpack_to_too_much_is_not_unpacked(
    made: ScenarioSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = [b"\0" * (64 << 20) for _ in range(2)]
    path = rewrite(tmp_path, made, {"content": contents}, compression="zstd")
    assert path.stat().st_size < 1 << 20

    def unpack(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(pq.ParquetFile, "read_row_groups", unpack)
    assert refuse(tmp_path, made).startswith(f"{path}: map hand-made unpacks to 134217")
    # Nor where only the footer says that it is small, or the rest is on another page.
    _footer_says(path, 1000)
    assert refuse(tmp_path, made).startswith(f"{path}: map hand-made unpacks to 134217")
    small = {"content": [b"<net/>", b"\0" * (64 << 20)]}
    rewrite(tmp_path, made, small, compression="zstd", data_page_size=1, write_batch_size=1)
    assert "row group 0 has more than one page" in refuse(tmp_path, made)


def _footer_says(path: Path, size: int) -> None:
    """Write another unpacked size of the contents into a store's footer, in as many bytes."""
    said = pq.read_metadata(path)
    data = bytearray(path.read_bytes())
    old = said.row_group(0).column(4).total_uncompressed_size
    packed = [(2 * old >> shift) & 0x7F | 0x80 for shift in range(0, 28, 7)] + [2 * old >> 28]
    place = data.index(bytes(packed), len(data) - said.serialized_size - 8)
    data[place : place + 5] = bytes((2 * size >> shift) & 0x7F | 0x80 for shift in range(0, 28, 7)) + b"\0"
    path.write_bytes(data)
    assert pq.read_metadata(path).row_group(0).column(4).total_uncompressed_size == size


def test_no_store_of_such_a_map_is_written(tmp_path: Path) -> None:
    path = tmp_path / "yield.parquet"
    with pytest.raises(InputError, match=f"map a: more than {MOST_BYTES} bytes"):
        write_store([("a", {"n": bytes(MOST_BYTES), "m": b"1"})], path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a readable store of scene files"),
        (b"PAR1 and no more PAR1", "not a readable store of scene files"),
        (None, "row group 0 is not of one map"),
    ],
)
def test_what_is_no_store(made: ScenarioSpec, tmp_path: Path, content: bytes | None, words: str) -> None:
    if content is None:
        path = rewrite(tmp_path, made, {"map_id": ["a", "b"]})
    else:
        path = store_path("test", "yield", tmp_path)
        path.write_bytes(content)
    text = refuse(tmp_path, made)
    assert text.startswith(f"{path}: ")
    assert words in text


def test_a_store_of_another_version_or_with_other_columns(made: ScenarioSpec, tmp_path: Path) -> None:
    path = store_path("test", "yield", tmp_path)
    table = pq.read_table(path)
    for other in (table.drop_columns(["size"]), table.replace_schema_metadata({"tsbench_schema": "2"})):
        pq.write_table(other, path)
        assert refuse(tmp_path, made) == f"{path}: is not a store of scene files that this tsbench reads"


def test_pages_that_are_broken(made: ScenarioSpec, tmp_path: Path) -> None:
    path = store_path("test", "yield", tmp_path)
    data = bytearray(path.read_bytes())
    start = pq.read_metadata(path).row_group(0).column(4).data_page_offset
    frame = data.index(b"\x28\xb5\x2f\xfd", start)
    data[frame : frame + 4] = bytes(4)
    path.write_bytes(data)
    assert refuse(tmp_path, made).startswith(f"{path}: not a readable store of scene files")
