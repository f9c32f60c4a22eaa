"""The data set as one page: types with their plates, maps on a map, every scene with its picture and certificate."""

from __future__ import annotations

import io
import math
from base64 import b64encode
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as PilImage

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.parallel import worker_processes
from tsbench.core.parquet import open_table
from tsbench.make.scenes.overview import TypeStats, type_stats
from tsbench.report.drawing.canvas import STYLE, PageSize
from tsbench.report.drawing.road_shapes import ground_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import scene_shapes
from tsbench.report.page.page_format import drawing, pack, pack_table, page_column, plate_keys, plate_of, render_page
from tsbench.report.scene_pictures import scene_picture
from tsbench.scenarios.certificates import Certificate, certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import POOL_SCHEMA
from tsbench.scenarios.scene_loader import SceneLoader, load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.countries import Artwork
from tsbench.signs.model import ScenarioType, Sign
from tsbench.signs.plates import plate_svg

_COLUMNS = ("map_id", "source", "east", "north", "lat", "lon", "road_class")


def pack_places(pool: Path, rows: Sequence[ScenarioSpec]) -> bytes:
    """Header: unit (m), east0, north0 (UTM 37 north), sources [name, x, y], used maps; arrays x, y of the whole pool.

    A used map: id, x, y, lat, lon, road class, source, split, types.
    """
    table = open_table(pool, POOL_SCHEMA, "tsbench maps harvest makes it", _COLUMNS)
    column: dict[str, list[Any]] = {name: table[name].to_pylist() for name in _COLUMNS}
    east, north = np.array(column["east"]), np.array(column["north"])
    middle = (float(np.median(east)), float(np.median(north)))
    reach = max(float(np.abs(east - middle[0]).max()), float(np.abs(north - middle[1]).max()))
    unit = max(round(reach / 32_000 + 0.5), 1)
    x, y = (np.rint((a - m) / unit).astype(np.int16) for a, m in zip((east, north), middle, strict=True))
    place = {name: k for k, name in enumerate(column["map_id"])}
    types: dict[str, set[str]] = defaultdict(set)
    splits: dict[str, str] = {}
    for row in rows:
        types[row.map_id].add(row.scenario_type)
        splits[row.map_id] = row.split
    used = []
    for name in sorted(types):
        k = place[name]
        spot: dict[str, Any] = {
            "id": name,
            "x": int(x[k]),
            "y": int(y[k]),
            "lat": round(column["lat"][k], 5),
            "lon": round(column["lon"][k], 5),
            "road": column["road_class"][k],
            "source": column["source"][k],
        }
        used.append({**spot, "split": splits[name], "types": sorted(types[name])})
    header = {"unit": unit, "sources": _sources(column["source"], x, y), "used": used}
    order = np.lexsort((y, x))
    return pack(header, {"x": x[order], "y": y[order]})


def _sources(names: Sequence[str], x: Any, y: Any) -> list[list[Any]]:
    by_name = defaultdict(list)
    for k, name in enumerate(names):
        by_name[name].append(k)
    ordered = sorted(by_name.items(), key=lambda item: (-len(item[1]), item[0]))
    return [[name, int(np.median(x[ks])), int(np.median(y[ks])), len(ks)] for name, ks in ordered]


# Scenario type and map.
Group = tuple[str, str]


def pack_scenes(
    data: DataSet, groups: Mapping[Group, Sequence[ScenarioSpec]], workers: int, progress: Callable[[int, int], None]
) -> Iterator[tuple[Group, bytes, set[str]]]:
    """Blobs in the groups' order (`roads` by network, `scenes` by id, each with its `net`), and the plates in them."""
    with worker_processes(min(workers, len(groups)), "packing scenes") as pool:
        packed = pool.ordered(_pack, ((data, rows) for rows in groups.values()))
        for done, (key, (content, plates)) in enumerate(zip(groups, packed, strict=True), start=1):
            progress(done, len(groups))
            yield key, content, plates


@cache
def _loader(data: DataSet) -> SceneLoader:
    return SceneLoader(data)


def _pack(data: DataSet, rows: Sequence[ScenarioSpec]) -> tuple[bytes, set[str]]:
    scenes, nets = {}, {}
    plates: set[str] = set()
    for row in rows:
        scene, roads = _loader(data).load(row)
        # The halves of a pair are of one variant, and may have networks of their own.
        shown = drawing(scene_shapes(scene, roads.graph, start=True))
        scenes[row.scenario_id] = {**shown, "net": row.net_sha256}
        if row.net_sha256 not in nets:
            nets[row.net_sha256] = drawing((*ground_shapes(scene, row.map_id), *road_shapes(scene.network, scene)))
        plates |= set(plate_keys(shown))
    return pack({"roads": nets, "scenes": scenes}), plates


_YES = ["no", "yes", "–"]
_GOOD, _BAD, _LOST = {"yes": "good", "no": "bad"}, {"no": "bad"}, {"nobody": "bad"}
_SANE = "traffic as asked, nobody inside another, both episodes came to an end"
_GAP = "the convoy's unhindered arrival at the conflict zone less the ego's"
_DENSITY = "cars/lane-km"
_flag = partial(page_column, kind="flag", words=_YES)
COLUMNS = (
    page_column("scenario_type", "type", filter="choice"),
    page_column("group", "group", filter="choice", minor=True),
    page_column("split", "split", filter="choice"),
    page_column("map_id", "map", filter="text"),
    page_column("variant", "variant", "number", digits=0),
    page_column("half", "half", filter="choice"),
    page_column(
        "expert", "solved by", filter="choice", marks=_LOST, title="the expert that obeyed the sign and arrived"
    ),
    page_column("expert_time_s", "after", "number", unit="s", minor=True),
    _flag("tempting", "tempting", filter="choice", marks=_GOOD, title="a driver who does not see signs failed"),
    page_column("blind_outcome", "blind baseline", filter="choice", minor=True),
    _flag("engaged", "engaged", minor=True, title="the rule bound the blind baseline"),
    _flag("sane", "sane", filter="choice", marks=_BAD, title=_SANE),
    _flag("reproduced", "again", minor=True, marks=_BAD, title="a second process drove it to the same bytes"),
    page_column(
        "asked_density", "asked", "number", unit=_DENSITY, title="density of moving cars that the scene asks for"
    ),
    page_column("realised_density", "realised", "number", unit=_DENSITY),
    page_column("arrival_gap_s", "gap", "number", unit="s", minor=True, title=_GAP),
    page_column("scenario_id", "scenario", minor=True),
)
_DETAILS = (
    ("sign_code", "text"), ("sign_value", "number"), ("initial_speed", "number"), ("route_length", "number"),
    ("horizon", "number"), ("density", "number"), ("drivers", "number"), ("layout", "number"), ("seed", "text"),
    ("shape", "text"), ("family", "text"), ("attempt", "number"), ("road_users", "number"), ("blind_baseline", "text"),
)  # fmt: skip


def pack_rows(rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> bytes:
    values = {column["name"]: _column(column["name"], rows, proofs) for column in COLUMNS}
    values["expert"] = [name or "nobody" for name in values["expert"]]
    return pack_table(COLUMNS, values)


def pack_details(rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> bytes:
    columns = [{"name": name, "label": name.replace("_", " "), "kind": kind} for name, kind in _DETAILS]
    values = {name: _column(name, rows, proofs) for name, _ in _DETAILS}
    values["seed"] = [str(seed) for seed in values["seed"]]
    return pack_table(columns, values)


def _column(name: str, rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> list[Any]:
    source: Sequence[Any] = rows if hasattr(rows[0], name) else proofs
    return [_plain(getattr(item, name)) for item in source]


def _plain(value: Any) -> Any:
    """JSON has no NaN; two digits are enough to look at."""
    if isinstance(value, float):
        return round(value, 2) if math.isfinite(value) else None
    return value


LARGEST_BYTES = 20_000_000
_PICTURE = PageSize(440, 260 + STYLE.header_px + STYLE.compact_footer_px)
_QUALITY = 82
Progress = Callable[[int, int], None]


def write_dataset_page(data: DataSet, rows: Sequence[ScenarioSpec], out: Path, workers: int, progress: Progress) -> int:
    """Write the page of `rows`; returns its size in bytes. progress(done, of): scenes of maps packed.

    Raises InputError: no rows, a scene file or certificate that is missing or changed, a page over 20 MB.
    """
    if not rows:
        raise InputError("no scenario is selected (tsbench scenarios list names them)")
    rows = sorted(rows, key=lambda row: (data.catalog.type(row.scenario_type).row, row.map_id, row.variant))
    proofs = _certificates(data, rows)
    groups: dict[Group, list[ScenarioSpec]] = defaultdict(list)
    for row in rows:
        groups[(row.scenario_type, row.map_id)].append(row)
    blobs = {
        "places": pack_places(data.pool_path, rows),
        "scenarios": pack_rows(rows, proofs),
        "details": pack_details(rows, proofs),
    }
    plates: set[str] = set()
    for key, packed, shown in pack_scenes(data, groups, workers, progress):
        blobs["/".join(("scene", *key))] = packed
        plates |= shown
    artwork = data.artwork()
    pictures = {key: plate_of(artwork, key) for key in sorted(plates)}
    text = render_page(
        "dataset.html",
        title="tsbench scenarios",
        data={"plates": pictures},
        blobs=blobs,
        scripts=("dataset_map.js", "dataset.js"),
        cards=_cards(data, rows),
        facts=_facts(rows, proofs),
    )
    content = text.encode()
    if len(content) > LARGEST_BYTES:
        raise InputError(f"{out}: the page would have {len(content) / 1e6:.0f} MB; give --types or --split")
    with io_errors_as_input_errors(out):
        write_atomic(out, content)
    return len(content)


def _certificates(data: DataSet, rows: Sequence[ScenarioSpec]) -> list[Certificate]:
    known = {c.scenario_id: c for c in certificates_of(data)}
    missing = [row.scenario_id for row in rows if row.scenario_id not in known]
    if missing:
        raise InputError(
            f"{data.certificates_path}: no certificate for {missing[0]} (tsbench scenarios build makes it)"
        )
    return [known[row.scenario_id] for row in rows]


def _cards(data: DataSet, rows: Sequence[ScenarioSpec]) -> list[dict[str, Any]]:
    stats: dict[str, list[TypeStats]] = defaultdict(list)
    for entry in type_stats(data, rows):
        stats[entry.type_id].append(entry)
    first: dict[str, ScenarioSpec] = {}
    for row in rows:
        first.setdefault(row.scenario_type, row)
    return [_card(kind, data, stats[kind.id], first[kind.id]) for kind in data.catalog.types if kind.id in first]


def _card(kind: ScenarioType, data: DataSet, stats: Sequence[TypeStats], example: ScenarioSpec) -> dict[str, Any]:
    signs = [data.catalog.sign(code) for code in kind.codes]
    n = sum(entry.rows for entry in stats)
    shares = {
        name: f"{100 * sum(getattr(entry, name) * entry.rows for entry in stats) / n:.0f} %"
        for name in ("solvable", "tempting", "engaged", "sane")
    }
    return {
        "id": kind.id,
        "group": kind.group,
        "family": kind.family.replace("_", " "),
        "names": list(dict.fromkeys(sign.name_en for sign in signs)),
        "codes": [sign.code for sign in signs],
        "plates": [(sign.code, _svg_uri(data.artwork(), sign, example)) for sign in signs],
        "counts": [f"{entry.split} {entry.rows:,} on {entry.maps} maps" for entry in stats],
        "shares": shares,
        "example": example.scenario_id,
        "picture": _picture(data, example),
    }


def _svg_uri(artwork: Artwork, sign: Sign, example: ScenarioSpec) -> str:
    """The plate with the number that the example has, or the smallest that it may have."""
    value = sign.value.allowed[0] if sign.value is not None else None
    if sign.code == example.sign_code:
        value = example.sign_value
    return f"data:image/svg+xml;base64,{b64encode(plate_svg(artwork, sign.code, value).encode()).decode()}"


def _picture(data: DataSet, example: ScenarioSpec) -> str:
    page = scene_picture(load_scene(data, example), example.scenario_id, _PICTURE, map_id=example.map_id)
    view = np.ascontiguousarray(page[_PICTURE.header_px : -_PICTURE.footer_px])
    file = io.BytesIO()
    PilImage.fromarray(view).save(file, format="WEBP", quality=_QUALITY, method=6)
    return f"data:image/webp;base64,{b64encode(file.getvalue()).decode()}"


def _facts(rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> Mapping[str, str]:
    n = len(rows)
    splits = {split: sum(row.split == split for row in rows) for split in sorted({r.split for r in rows})}
    checked = [proof.reproduced for proof in proofs if proof.reproduced is not None]
    return {
        "scenarios": f"{n:,} ({', '.join(f'{name} {count:,}' for name, count in splits.items())})",
        "types": str(len({row.scenario_type for row in rows})),
        "maps": f"{len({row.map_id for row in rows}):,}",
        "solvable": f"{sum(p.solvable for p in proofs) / n:.1%}: an expert obeyed the sign and arrived",
        "tempting": f"{sum(p.tempting for p in proofs) / n:.1%}: a driver who does not see signs failed",
        "engaged": f"{sum(p.engaged for p in proofs) / n:.1%}: the rule bound that driver",
        "sane": f"{sum(p.sane for p in proofs) / n:.1%}: traffic as asked, nobody inside another",
        "reproduced": f"{sum(checked):,} of {len(checked):,} that a second process drove came out the same",
    }
