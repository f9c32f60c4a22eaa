"""Gets an OSM extract from Overpass through OSMnx (extra `fetch`), cached with its SHA-256."""

from __future__ import annotations

import gzip
import json
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.extras import load
from tsbench.core.files import sha256_of, write_atomic, write_json

Box = tuple[float, float, float, float]  # west, south, east, north, degrees
WAY_TAGS = (
    "highway", "oneway", "lanes", "lanes:forward", "lanes:backward", "maxspeed", "maxspeed:forward",
    "maxspeed:backward", "turn:lanes", "junction", "name", "access", "service", "width", "bridge", "tunnel", "layer",
)  # fmt: skip
MAX_DEGREES = 1.5


@dataclass(frozen=True)
class Fetched:
    """An extract on disk; `cached`: it was there already, with the right checksum."""

    path: Path
    sha256: str
    cached: bool


def parse_box(text: str) -> Box:
    """`west,south,east,north` in degrees."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--bbox {text}: expected west,south,east,north in degrees, e.g. 37.60,55.74,37.64,55.76"
        ) from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise InputError(f"--bbox {text}: west must be below east and south below north, in degrees")
    if east - west > MAX_DEGREES or north - south > MAX_DEGREES:
        raise InputError(f"--bbox {text}: larger than {MAX_DEGREES} degrees; Overpass would refuse it")
    return west, south, east, north


def fetch_extract(out_dir: Path, *, name: str | None, place: str | None, box: Box | None) -> Fetched:
    """Fetch the car roads of a place or box to `out_dir/<name>.osm.gz`, unless it is there already."""
    if (place is None) == (box is None):
        raise InputError("maps fetch: give either a place name or --bbox, and not both")
    query = place if place is not None else ",".join(f"{value:.6f}" for value in box or ())
    stem = name or re.sub(r"[^a-z0-9]+", "-", query.lower()).strip("-") or "extract"
    if not re.fullmatch(r"[A-Za-z0-9_-]+", stem):
        raise InputError(f"--name {stem}: letters, digits, '-' and '_' only")
    path, note = out_dir / f"{stem}.osm.gz", out_dir / f"{stem}.json"
    if path.is_file() and note.is_file():
        known = json.loads(note.read_text(encoding="utf-8"))
        if known.get("query") == query and known.get("sha256") == sha256_of(path):
            return Fetched(path, known["sha256"], True)
    data = _download(place, box)
    write_atomic(path, gzip.compress(data, mtime=0))
    digest = sha256_of(path)
    facts = {"query": query, "sha256": digest, "licence": "ODbL 1.0, © OpenStreetMap contributors"}
    write_json(note, facts, indent=1)
    return Fetched(path, digest, False)


def _download(place: str | None, box: Box | None) -> bytes:
    """OSM XML of the car roads, straight from OSMnx."""
    osmnx: Any = load("osmnx")
    osmnx.settings.use_cache = False
    osmnx.settings.all_oneway = True
    osmnx.settings.useful_tags_way = list(WAY_TAGS)
    what = place if place is not None else f"bbox {box}"
    try:
        options: dict[str, Any] = {"network_type": "drive", "simplify": False, "retain_all": True}
        graph = (
            osmnx.graph.graph_from_place(place, **options)
            if place is not None
            else osmnx.graph.graph_from_bbox(box, **options)
        )
        with tempfile.TemporaryDirectory(prefix="tsbench-fetch-") as folder:
            path = Path(folder) / "extract.osm"
            osmnx.io.save_graph_xml(graph, filepath=path)
            return path.read_bytes()
    except (OSError, ValueError, TypeError, RuntimeError) as failure:
        reason = " ".join(str(failure).split())[:200]
        raise InputError(
            f"{what}: OSMnx got no extract from the network ({type(failure).__name__}: {reason})"
        ) from failure
