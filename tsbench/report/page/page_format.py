"""HTML pages: templates rendered into one file, compressed data, and shapes for the bird's-eye view in a page.

A page's own policy allows no network. The same input always gives the same bytes.

Packed data, before gzip: uint32 (little endian) length of the header, the header as UTF-8 JSON, then the arrays one
after the other. `arrays` in the header: for each `[name, kind, length]`; kind `i8` is int8, `i16` is int16 with all low
bytes before all high bytes, for slowly changing values have equal high bytes that pack to nothing.

`static/bev.js` describes the format of shapes. Coordinates are whole tenths of a metre, each point but a shape's first
relative to the one before, so that they compress well. Units: m in the network's frame, rad.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import struct
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

import tsbench
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.canvas import ATTRIBUTION, STYLE, Area, Body, DrawnPlate, Line, Shape, cone_places
from tsbench.report.drawing.road_shapes import main_road_svg
from tsbench.signs.countries import Artwork
from tsbench.signs.plates import plate_svg
from tsbench.sim import main_road

_PACKAGE = "tsbench.report.page"
BASE_SCRIPTS = ("core.js", "table.js", "bev.js")


@cache
def environment() -> Environment:
    """Templates, HTML with escaping on; a name that is not given is an error."""
    return Environment(
        loader=PackageLoader(_PACKAGE),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def render_page(
    template: str,
    *,
    title: str,
    data: Mapping[str, Any] | None = None,
    blobs: Mapping[str, bytes] | None = None,
    scripts: Sequence[str] = (),
    served: bool = False,
    **context: Any,
) -> str:
    """A whole page. data, blobs: see the package; scripts: files of `static/` beside the base ones.

    served: the page may ask the server that it came from alone; otherwise it may ask no server.
    """
    script = "\n".join(static_text(name) for name in (*BASE_SCRIPTS, *scripts))
    encoded = {name: b64encode(content).decode() for name, content in (blobs or {}).items()}
    return environment().get_template(template).render(
        title=title, data=dict(data or {}), blobs=encoded, style=Markup(static_text("base.css") + _bev_colours()),
        script=Markup(script), policy=_policy(script, served), version=tsbench.__version__, attribution=ATTRIBUTION,
        **context,
    )  # fmt: skip


@cache
def static_text(name: str) -> str:
    """A file of `static/`. Raises ValueError where it would end the element that it is put into."""
    text = files(_PACKAGE).joinpath("static", name).read_text(encoding="utf-8")
    if "</script" in text or "</style" in text:
        raise ValueError(f"{name}: holds the end of an element")
    return text


def _policy(script: str, served: bool) -> str:
    """Content security policy: only this very script runs."""
    digest = b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    parts = ["default-src 'none'", f"script-src 'sha256-{digest}'", "style-src 'unsafe-inline'"]
    parts += ["img-src data:", "base-uri 'none'", "form-action 'none'"]
    if served:
        parts.append("connect-src 'self'")
    return "; ".join(parts)


def _bev_colours() -> str:
    """The colours of bird's-eye pictures as CSS variables; `base.css` darkens some of them."""
    colours = {f.name: getattr(STYLE, f.name) for f in fields(STYLE)}
    named = {k: v for k, v in colours.items() if isinstance(v, tuple) and len(v) == 3}
    return ":root{" + "".join(f"--bev-{k}:rgb{v};" for k, v in named.items()).replace(" ", "") + "}"


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
    whole = {**header, "arrays": described}
    head = json.dumps(whole, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return gzip.compress(struct.pack("<I", len(head)) + head + b"".join(parts), _LEVEL, mtime=0)


def page_column(name: str, label: str, kind: str = "text", **more: Any) -> dict[str, Any]:
    """A column of `pack_table`. kind: text, number or flag; more: what `table.js` names besides."""
    return {"name": name, "label": label, "kind": kind, **more}


def pack_table(columns: Sequence[Mapping[str, Any]], values: Mapping[str, Sequence[Any]]) -> bytes:
    """A table for `tsb.table`: one list for each column, texts as numbers of a list of the different ones."""
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


UNIT_M = 0.1
_SIMPLER_M = 0.05


def drawing(shapes: Iterable[Shape]) -> dict[str, Any]:
    areas: list[dict[str, Any]] = []
    lines: list[dict[str, Any]] = []
    plates: list[dict[str, Any]] = []
    bodies: list[dict[str, Any]] = []
    for shape in shapes:
        match shape:
            case Area():
                rings = [r for p in _parts(shape.polygon) for r in (p.exterior, *p.interiors)]
                flat = [_flat(shapely.get_coordinates(ring)[:-1]) for ring in rings]
                _add_shapes(areas, {"c": shape.colour, "a": shape.opacity}, "r", flat)
            case Line():
                parts = _parts(shapely.LineString(shape.points))
                flat = [_flat(shapely.get_coordinates(part)) for part in parts]
                _add_shapes(lines, {"c": shape.colour, "w": shape.width, "a": 1.0}, "p", flat)
            case Body(kind="cones"):
                bodies += [_body_dict("cone", x, y) for x, y in cone_places(shape).tolist()]
            case Body():
                bodies.append(_body_dict(shape.kind, shape.x, shape.y, shape.heading, shape.length, shape.width))
            case DrawnPlate():
                place = {
                    "x": round(shape.x, 2),
                    "y": round(shape.y, 2),
                    "ax": round(float(shape.away[0]), 3),
                    "ay": round(float(shape.away[1]), 3),
                    "clear": round(shape.clear, 1),
                }
                own = {"plate": plate_key(shape.code, shape.value, temporary=shape.temporary), "below": shape.below}
                plates.append({**place, **own, "target": shape.target})
    drawn = {"areas": areas, "lines": lines, "plates": plates, "bodies": bodies}
    return {"unit": UNIT_M, "x0": 0, "y0": 0, **drawn}


def _parts(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """The polygons or lines of a shape, as simple as the page's unit allows."""
    kind = "LineString" if shape.geom_type == "LineString" else "Polygon"
    parts = shapely.get_parts(shapely.simplify(shape, _SIMPLER_M))
    return [part for part in parts if part.geom_type == kind and not part.is_empty]


def _add_shapes(where: list[dict[str, Any]], look: dict[str, Any], key: str, shapes: list[list[int]]) -> None:
    """Shapes that look alike and follow each other are one."""
    if shapes and where and {k: v for k, v in where[-1].items() if k != key} == look:
        where[-1][key] += shapes
    elif shapes:
        where.append({**look, key: shapes})


def _body_dict(kind: str, *numbers: float) -> dict[str, Any]:
    x, y, h, length, width = (round(v, 2) for v in (*numbers, 0.0, 0.0, 0.0)[:5])
    return {"c": kind, "x": x, "y": y, "h": h, "l": length, "w": width}


_TEMPORARY = "|temporary"


def plate_key(code: str, value: float | None, *, temporary: bool = False) -> str:
    return code + (f"|{value:g}" if value is not None else "") + (_TEMPORARY if temporary else "")


def plate_keys(drawing: dict[str, Any]) -> tuple[str, ...]:
    """Of all plates of a drawing, with those that hang beneath others."""
    keys = (plate[name] for plate in drawing["plates"] for name in ("plate", "below"))
    return tuple(dict.fromkeys(key for key in keys if key))


def plate_of(artwork: Artwork, key: str) -> str:
    """A plate's picture as SVG. Raises InputError or ValueError for a key that names none."""
    usual = key.removesuffix(_TEMPORARY)
    code, bar, value = usual.partition("|")
    if code == main_road.CODE:
        return main_road_svg(key)
    return plate_svg(artwork, code, float(value) if bar else None, temporary=usual != key)


def _flat(points: Array) -> list[int]:
    """Whole tenths of a metre: the first point, then steps."""
    whole = np.rint(points / UNIT_M).astype(np.int64)
    steps: list[int] = np.diff(whole, axis=0, prepend=0).ravel().tolist()
    return steps
