"""The files of scenes: `scenarios/scenes/<split>/<type>.parquet`, one row per file, one row group per map.

A file is kept under the name by which scenario rows name it. Maps and names are sorted and nothing else is written, so
that the same files give the same bytes under one version of pyarrow, which each store names.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError
from tsbench.core.files import replacing
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, columns
from tsbench.core.xmlfile import read_plain, sha256
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import SceneFile

# The files of one map, unpacked: ten times what the largest has. What Parquet adds to them is no more than they.
MOST_BYTES = 4 << 20
_MOST_UNPACKED = 2 * MOST_BYTES
_KEPT_MAPS = 4
# Of a page's header, which has its bounds and counts besides its sizes.
_HEAD_BYTES = 256
_INT32_NEXT = 0x15

SCHEMA = pa.schema(
    [*columns(pa.string(), "map_id", "name", "sha256"), *columns(pa.int64(), "size"), *columns(pa.binary(), "content")]
).with_metadata({VERSION_KEY: "1", **OSM_LICENCE})


class SceneFiles(Protocol):
    """Where the files of scenes are read from."""

    def read(self, spec: ScenarioSpec, name: str) -> SceneFile:
        """The file that a row names. Raises InputError for one that is missing or broken."""


def store_path(split: str, type_id: str, where: DataSet | Path) -> Path:
    """Where the scenes of a type in a split stand; a folder: `scenarios/`."""
    if isinstance(where, Path):
        return where / f"scenes/{split}/{type_id}.parquet"
    stored = where.image.mirrored_type(type_id) if where.image else type_id
    return where.file(f"scenarios/scenes/{split}/{stored}.parquet")


def write_store(maps: Iterable[tuple[str, Mapping[str, bytes]]], path: Path) -> None:
    """Write the files (name, plain content) of maps (their ids), sorted by id, atomically.

    Raises InputError for a map with more than MOST_BYTES.
    """
    # Dictionaries do not help where no value occurs twice; one page a map lets zstd see what its files share.
    layout: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": 19,
        "use_dictionary": False,
        "write_statistics": ["map_id"],
        "data_page_size": _MOST_UNPACKED,
    }
    with replacing(path) as part, pq.ParquetWriter(part, SCHEMA, **layout) as writer:
        for map_id, files in sorted(maps, key=lambda one: one[0]):
            if sum(map(len, files.values())) > MOST_BYTES:
                raise InputError(f"{path}: map {map_id}: more than {MOST_BYTES} bytes of scene files")
            rows = [
                {"map_id": map_id, "name": name, "sha256": sha256(c), "size": len(c), "content": c}
                for name, c in sorted(files.items())
            ]
            writer.write_table(pa.Table.from_pylist(rows, schema=SCHEMA))


@dataclass(frozen=True)
class _Opened:
    """A store whose footer was read. source: its bytes. groups: number of the row group by map."""

    path: Path
    source: pa.NativeFile
    file: pq.ParquetFile
    groups: dict[str, int]

    def table(self, maps: Sequence[str], names: list[str]) -> pa.Table:
        """Columns of maps, refused before they are unpacked where they say that they are too large."""
        groups = [self.groups[m] for m in maps]
        try:
            for map_id, group in zip(maps, groups, strict=True):
                size = max(self._unpacked(group, SCHEMA.get_field_index(name)) for name in names)
                if size > _MOST_UNPACKED:
                    told = f"map {map_id} unpacks to {size} bytes, at most {_MOST_UNPACKED} are read"
                    raise InputError(f"{self.path}: {told}")
            return self.file.read_row_groups(groups, names, use_threads=False)
        except (pa.ArrowException, ValueError, OSError) as error:
            raise _unreadable(self.path, error) from None

    def _unpacked(self, group: int, column: int) -> int:
        """Bytes of a column of a map, unpacked: as its one page says, which Arrow believes, not the footer."""
        chunk = self.file.metadata.row_group(group).column(column)
        self.source.seek(chunk.data_page_offset)
        head = iter(self.source.read(_HEAD_BYTES))
        _, unpacked, packed = (_next_int(head) for _ in range(3))
        # Nothing of weight is left for a second page.
        if chunk.has_dictionary_page or packed + _HEAD_BYTES < chunk.total_compressed_size:
            raise ValueError(f"row group {group} has more than one page")
        return unpacked


def _next_int(head: Iterator[int]) -> int:
    """The next field of a page's header; the first three are int32 in Thrift's compact form. ValueError for others."""
    if next(head, None) != _INT32_NEXT:
        raise ValueError("a page without its sizes")
    value = 0
    for shift, byte in zip(range(0, 35, 7), head, strict=False):
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            break
    return (value >> 1) ^ -(value & 1)


class SceneStore:
    """Reads the scenes of a data set, or those below a `scenarios/` folder; the last few maps stay unpacked."""

    def __init__(self, where: DataSet | Path) -> None:
        self.where = where
        self._opened: dict[Path, _Opened] = {}
        self._maps: OrderedDict[tuple[Path, str], dict[str, bytes]] = OrderedDict()

    def read(self, spec: ScenarioSpec, name: str) -> SceneFile:
        """The file that a row names. Raises InputError for one that is missing, broken or too large."""
        path = store_path(spec.split, spec.pair_type, self.where)
        content = self._map(path, spec.map_id).get(name)
        if content is None:
            raise InputError(f"{path / name}: no such scene file")
        return SceneFile(path / name, content)

    def names(self, split: str, type_id: str) -> dict[str, str]:
        """SHA-256, as the store says it, of each file of a type in a split. Raises InputError for a broken store."""
        opened = self._open(store_path(split, type_id, self.where))
        table = opened.table(tuple(opened.groups), ["name", "sha256"])
        return dict(zip(table["name"].to_pylist(), table["sha256"].to_pylist(), strict=True))

    def _map(self, path: Path, map_id: str) -> dict[str, bytes]:
        """Contents of a map's files by name; none for a map that the store does not have."""
        key = (path, map_id)
        kept = self._maps.get(key)
        if kept is None:
            opened = self._open(path)
            if map_id not in opened.groups:
                return {}
            files = opened.table((map_id,), ["name", "size", "content"]).to_pydict()
            kept = {}
            for name, size, content in zip(*files.values(), strict=True):
                if len(content) != size:
                    raise InputError(f"{path / name}: has {len(content)} bytes, not the {size} that it says")
                kept[name] = content
            self._maps[key] = kept
            if len(self._maps) > _KEPT_MAPS:
                self._maps.popitem(last=False)
        self._maps.move_to_end(key)
        return kept

    def _open(self, path: Path) -> _Opened:
        opened = self._opened.get(path)
        if opened is None:
            if not path.is_file():
                here = DataSet() if isinstance(self.where, Path) else self.where
                hint = here.fetch_hint(path.parent.name)
                raise InputError(f"{path}: no such scene files ({hint})")
            try:
                source = pa.memory_map(str(path))
                file = pq.ParquetFile(source)
                groups = _groups(file)
            except (pa.ArrowException, ValueError, OSError) as error:
                raise _unreadable(path, error) from None
            if not file.schema_arrow.equals(SCHEMA) or (file.schema_arrow.metadata or {}) != SCHEMA.metadata:
                raise InputError(f"{path}: is not a store of scene files that this tsbench reads")
            opened = self._opened[path] = _Opened(path, source, file, groups)
        return opened


def _groups(file: pq.ParquetFile) -> dict[str, int]:
    """Row groups by map, from the bounds of their map's name in the footer. Raises ValueError where they lack."""
    groups: dict[str, int] = {}
    for number in range(file.metadata.num_row_groups):
        bounds = file.metadata.row_group(number).column(0).statistics
        if bounds is None or not bounds.has_min_max or bounds.min != bounds.max:
            raise ValueError(f"row group {number} is not of one map")
        groups[str(bounds.min)] = number
    return groups


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: not a readable store of scene files ({' '.join(str(error).split())})")


def check_files(rows: Iterable[ScenarioSpec], data: DataSet) -> None:
    """Is there a file for each that rows name? A scene that is not there would fail every episode on it.

    Raises InputError for the first that is missing, and for a store that is.
    """
    store = SceneStore(data)
    there: dict[tuple[str, str], dict[str, str]] = {}
    for row in rows:
        kind = row.split, row.pair_type
        if kind not in there:
            there[kind] = store.names(*kind)
        for name in (row.net, row.additional):
            if name not in there[kind]:
                where = store_path(*kind, data) / name
                raise InputError(f"row {row.scenario_id} (map {row.map_id}): {where}: no such scene file")


class SceneFolder:
    """Reads scenes that are being built: plain or gzip files below `root`, by the names that rows give."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def read(self, spec: ScenarioSpec, name: str) -> SceneFile:  # noqa: ARG002
        """The file that a row names. Raises InputError for one that is missing or broken."""
        path = self.root / name
        return SceneFile(path, read_plain(path, "scene file"))
