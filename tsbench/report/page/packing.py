"""Data of a page as compressed bytes: a JSON header and typed arrays, the same input always the same bytes.

Layout before gzip: uint32 (little endian) length of the header, the header as UTF-8 JSON, then the arrays one after the
other. `arrays` in the header: for each `[name, kind, length]`; kind `i8` is int8, `i16` is int16 with all low bytes
before all high bytes, for slowly changing values have equal high bytes that pack to nothing.
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

_LEVEL = 9
_KINDS = {"int8": "i8", "int16": "i16"}


def pack(header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]] | None = None) -> bytes:
    """Compressed bytes. arrays: one-dimensional, int8 or int16. Raises ValueError for other ones."""
    described, parts = [], []
    for name, array in (arrays or {}).items():
        kind = _KINDS.get(array.dtype.name)
        if kind is None or array.ndim != 1:
            raise ValueError(f"{name}: {array.dtype}{list(array.shape)} cannot be packed")
        described.append([name, kind, len(array)])
        planes = array.astype(array.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, array.dtype.itemsize)
        parts.append(np.ascontiguousarray(planes.T).tobytes())
    text = json.dumps(
        {**header, "arrays": described}, ensure_ascii=False, allow_nan=False, separators=(",", ":")
    )
    head = text.encode()
    return gzip.compress(struct.pack("<I", len(head)) + head + b"".join(parts), _LEVEL, mtime=0)


def pack_table(columns: Sequence[Mapping[str, Any]], values: Mapping[str, Sequence[Any]]) -> bytes:
    """A table for `tsb.table`: one list for each column, texts as numbers of a list of the different ones.

    columns: `name`, `label`, `kind` (text, number, flag), and what `table.js` names besides.
    """
    packed: dict[str, Any] = {}
    for column in columns:
        found = list(values[column["name"]])
        if column["kind"] == "text":
            distinct = list(dict.fromkeys(found))
            place = {value: k for k, value in enumerate(distinct)}
            packed[column["name"]] = {"distinct": distinct, "at": [place[v] for v in found]}
        else:
            packed[column["name"]] = found
    rows = {len(v["at"] if isinstance(v, dict) else v) for v in packed.values()}
    if len(rows) != 1:
        raise ValueError(f"columns of {sorted(rows)} rows")
    return pack({"columns": [dict(c) for c in columns], "rows": rows.pop(), "values": packed})


def deltas(values: npt.NDArray[Any], starts: npt.NDArray[Any]) -> npt.NDArray[np.int16]:
    """Second differences of whole numbers (n,), begun anew at `starts`: value, first step, then changes of the step.

    Raises ValueError where one does not fit into 16 bits.
    """
    whole = np.asarray(values, dtype=np.int64)
    first = np.diff(whole, prepend=0)
    first[starts] = whole[starts]
    second = np.diff(first, prepend=0)
    fresh = np.concatenate((starts, starts + 1))
    fresh = fresh[fresh < len(whole)]
    second[fresh] = first[fresh]
    if len(second) and np.abs(second).max() > np.iinfo(np.int16).max:
        raise ValueError("a value that does not fit into 16 bits")
    return second.astype(np.int16)
