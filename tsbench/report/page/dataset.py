"""The data set as one page: types with their plates, maps on a map, every scene with its picture and certificate."""

from __future__ import annotations

import io
from base64 import b64encode
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as PilImage

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.dataset.scenes.overview import TypeStats, type_stats
from tsbench.report.drawing.layout import PageSize
from tsbench.report.drawing.style import STYLE
from tsbench.report.page.dataset_blobs import (
    Group,
    pack_details,
    pack_places,
    pack_rows,
    pack_scenes,
    scene_blob,
)
from tsbench.report.page.drawing import plate_of
from tsbench.report.page.shell import render_page
from tsbench.report.video.render import scene_picture
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.model import ScenarioType, Sign
from tsbench.signs.plates import plate_svg

LARGEST_BYTES = 20_000_000
_PICTURE = PageSize(440, 260 + STYLE.header_px + STYLE.compact_footer_px)
_QUALITY = 82
Progress = Callable[[int, int], None]


def write_dataset_page(rows: Sequence[ScenarioSpec], out: Path, workers: int, progress: Progress) -> int:
    """Write the page of `rows`; returns its size in bytes. progress(done, of): scenes of maps packed.

    Raises InputError: no rows, a scene file or certificate that is missing or changed, a page over 20 MB.
    """
    if not rows:
        raise InputError("no scenario is selected (tsbench scenarios list names them)")
    catalog = load_catalog()
    rows = sorted(rows, key=lambda row: (catalog.type(row.scenario_type).row, row.map_id, row.variant))
    proofs = _certificates(rows)
    groups: dict[Group, list[ScenarioSpec]] = defaultdict(list)
    for row in rows:
        groups[(row.scenario_type, row.map_id)].append(row)
    blobs = {
        "places": pack_places(rows),
        "scenarios": pack_rows(rows, proofs),
        "details": pack_details(rows, proofs),
    }
    plates: set[str] = set()
    for key, packed, shown in pack_scenes(groups, workers, progress):
        blobs[scene_blob(*key)] = packed
        plates |= shown
    pictures = {key: plate_of(key) for key in sorted(plates)}
    text = render_page(
        "dataset.html", title="tsbench scenarios", data={"plates": pictures}, blobs=blobs,
        scripts=("dataset_map.js", "dataset.js"), cards=_cards(rows, catalog), facts=_facts(rows, proofs),
    )  # fmt: skip
    content = text.encode()
    if len(content) > LARGEST_BYTES:
        raise InputError(f"{out}: the page would have {len(content) / 1e6:.0f} MB; give --types or --split")
    with io_errors_as_input_errors(out):
        write_atomic(out, content)
    return len(content)


def _certificates(rows: Sequence[ScenarioSpec]) -> list[Certificate]:
    path = certificates_path()
    known = {c.scenario_id: c for c in read_certificates(path)}
    missing = [row.scenario_id for row in rows if row.scenario_id not in known]
    if missing:
        raise InputError(f"{path}: no certificate for {missing[0]} (tsbench scenarios build makes it)")
    return [known[row.scenario_id] for row in rows]


def _cards(rows: Sequence[ScenarioSpec], catalog: Catalog) -> list[dict[str, Any]]:
    stats: dict[str, list[TypeStats]] = defaultdict(list)
    for entry in type_stats(rows):
        stats[entry.type_id].append(entry)
    first: dict[str, ScenarioSpec] = {}
    for row in rows:
        first.setdefault(row.scenario_type, row)
    return [
        _card(kind, catalog, stats[kind.id], first[kind.id]) for kind in catalog.types if kind.id in first
    ]


def _card(
    kind: ScenarioType, catalog: Catalog, stats: Sequence[TypeStats], example: ScenarioSpec
) -> dict[str, Any]:
    signs = [catalog.sign(code) for code in kind.codes]
    n = sum(entry.rows for entry in stats)
    shares = {
        name: f"{100 * sum(getattr(entry, name) * entry.rows for entry in stats) / n:.0f} %"
        for name in ("solvable", "tempting", "engaged", "sane")
    }
    return {
        "id": kind.id, "group": kind.group, "family": kind.family.replace("_", " "),
        "names": list(dict.fromkeys(sign.name_en for sign in signs)),
        "codes": [sign.code for sign in signs],
        "plates": [(sign.code, _svg_uri(sign, example)) for sign in signs],
        "counts": [f"{entry.split} {entry.rows:,} on {entry.maps} maps" for entry in stats],
        "shares": shares,
        "example": example.scenario_id,
        "picture": _picture(example),
    }  # fmt: skip


def _svg_uri(sign: Sign, example: ScenarioSpec) -> str:
    """The plate with the number that the example has, or the smallest that it may have."""
    value = sign.value.allowed[0] if sign.value is not None else None
    if sign.code == example.sign_code:
        value = example.sign_value
    return f"data:image/svg+xml;base64,{b64encode(plate_svg(sign.code, value).encode()).decode()}"


def _picture(example: ScenarioSpec) -> str:
    page = scene_picture(load_scene(example), example.scenario_id, _PICTURE, map_id=example.map_id)
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
