"""The page of the data set: what it holds, that it asks nobody, and that Chromium shows it."""

from __future__ import annotations

import gzip
import json
import re
import struct
from base64 import b64decode
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from browsing import opened
from command_line import in_process, refused

from tsbench.core.errors import InputError
from tsbench.make import dataset_page as module
from tsbench.make.dataset_page import write_dataset_page
from tsbench.make.scenes import overview
from tsbench.scenarios.certificates import Certificate, certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import SIGNED, ScenarioSpec

if TYPE_CHECKING:
    from playwright.sync_api import Browser

TYPES = ("yield", "speed_limit", "detour_left")


@pytest.fixture(scope="module", autouse=True)
def proofs() -> Iterator[list[Certificate]]:
    """All certificates, read once."""
    found = certificates_of(DataSet())
    with pytest.MonkeyPatch.context() as patch:
        for reader in (module, overview):
            patch.setattr(reader, "certificates_of", lambda _: found)
        yield found


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    """Three variants of one test map for each of three types."""
    table = [row for row in DataSet().table("test") if row.half == SIGNED]
    first = {kind: next(row.map_id for row in table if row.pair_type == kind) for kind in TYPES}
    return [row for row in table if row.map_id == first.get(row.pair_type) and row.variant in (0, 2, 5)]


@pytest.fixture(scope="module")
def page(rows: list[ScenarioSpec], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "new" / "scenarios.html"
    told: list[tuple[int, int]] = []
    size = write_dataset_page(DataSet(), rows, path, 1, lambda *at: told.append(at))
    assert size == path.stat().st_size
    assert told == [(1, 3), (2, 3), (3, 3)]
    return path


def unpacked(page: str, name: str) -> dict[str, Any]:
    found = re.search(rf'<script type="text/plain" data-blob="{re.escape(name)}">([^<]*)</script>', page)
    assert found is not None, name
    content = gzip.decompress(b64decode(found[1]))
    (size,) = struct.unpack_from("<I", content)
    header: dict[str, Any] = json.loads(content[4 : 4 + size])
    return header


def test_each_scene_is_there_with_its_certificate(
    page: Path, rows: list[ScenarioSpec], proofs: list[Certificate]
) -> None:
    text = page.read_text(encoding="utf-8")
    table = unpacked(text, "scenarios")
    assert table["rows"] == len(rows) == 9
    values = table["values"]
    names = [values["scenario_id"]["distinct"][k] for k in values["scenario_id"]["at"]]
    assert sorted(names) == sorted(row.scenario_id for row in rows)
    proof = {c.scenario_id: c for c in proofs}
    for k, name in enumerate(names):
        assert values["tempting"][k] is proof[name].tempting
        assert values["sane"][k] is proof[name].sane
        assert values["asked_density"][k] == pytest.approx(proof[name].asked_density, abs=0.01)
        expert = values["expert"]["distinct"][values["expert"]["at"][k]]
        assert expert == (proof[name].expert or "nobody")
    assert unpacked(text, "details")["rows"] == 9
    plates = json.loads(unescape(re.search(r'data-json="plates">(.*?)</script>', text)[1]))  # type: ignore[index]
    for kind in TYPES:
        row = next(row for row in rows if row.scenario_type == kind)
        scene = unpacked(text, f"scene/{kind}/{row.map_id}")
        assert set(scene["scenes"]) == {r.scenario_id for r in rows if r.scenario_type == kind}
        for drawing in scene["scenes"].values():
            assert scene["roads"][drawing["net"]]["areas"]
            assert [body["c"] for body in drawing["bodies"]].count("ego") == 1
            assert {plate["plate"] for plate in drawing["plates"]} <= set(plates)
            assert any(plate["target"] for plate in drawing["plates"])


def test_both_halves_of_a_pair_are_there(tmp_path: Path) -> None:
    """The halves of `bus_lane` have one type, one map and one variant; only the plate's lane tells them apart."""
    pair = [r for r in DataSet().table("dev") if r.pair_type == "bus_lane"][:2]
    write_dataset_page(DataSet(), pair, tmp_path / "pair.html", 1, lambda *at: None)
    text = (tmp_path / "pair.html").read_text(encoding="utf-8")
    packed = unpacked(text, f"scene/bus_lane/{pair[0].map_id}")
    signed, contrast = (packed["scenes"][r.scenario_id] for r in sorted(pair, key=lambda r: r.half == "contrast"))
    lanes = [[a["r"] for a in drawing["areas"] if a["c"] == "reserved"] for drawing in (signed, contrast)]
    assert all(lanes)
    assert lanes[0] != lanes[1]
    assert {signed["net"], contrast["net"]} == set(packed["roads"])


def test_the_map_has_the_pool_and_what_is_used(page: Path, rows: list[ScenarioSpec]) -> None:
    places = unpacked(page.read_text(encoding="utf-8"), "places")
    assert {place["id"] for place in places["used"]} == {row.map_id for row in rows}
    assert {t for place in places["used"] for t in place["types"]} == set(TYPES)
    for place in places["used"]:
        assert 55.0 < place["lat"] < 57.0
        assert 36.0 < place["lon"] < 39.0
    counts = {name: length for name, _, length in places["arrays"]}
    assert counts["x"] == counts["y"] == sum(n for *_, n in places["sources"]) > 1000


def test_the_page_asks_nobody_for_anything(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    outside = re.findall(r'(?:src|href|url|action)\s*[=(]\s*["\']?([a-z]+://[^"\')\s]+)', text)
    assert [u for u in outside if not u.startswith("http://www.w3.org/")] == []
    assert "connect-src" not in text
    assert text.count('<article class="card"') == 3
    assert "© OpenStreetMap contributors" in text


def test_what_cannot_be_shown_is_one_line(
    rows: list[ScenarioSpec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="no scenario is selected"):
        write_dataset_page(DataSet(), [], tmp_path / "a.html", 1, lambda *_: None)
    told = refused(in_process("scenarios", capsys), "browse", "--types", "fly")
    assert "--types fly: no such type" in told
    monkeypatch.setattr(module, "certificates_of", lambda _: [])
    with pytest.raises(InputError, match="no certificate for "):
        write_dataset_page(DataSet(), rows[:1], tmp_path / "a.html", 1, lambda *_: None)
    assert list(tmp_path.iterdir()) == []


def test_a_page_that_is_too_large_is_not_written(
    rows: list[ScenarioSpec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LARGEST_BYTES", 1000)
    monkeypatch.setattr(module, "pack_scenes", lambda *_: ())
    with pytest.raises(InputError, match="give --types or --split"):
        write_dataset_page(DataSet(), rows[:1], tmp_path / "a.html", 1, lambda *_: None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("width", [1280, 390])
def test_chromium_shows_scenes_and_filters(chromium: Browser, page: Path, width: int) -> None:
    with opened(chromium, page.as_uri(), "#scenario-table tbody tr", (width, 844)) as tab:
        assert tab.locator("#scenario-table tbody tr").count() == 9
        tab.click("#type-detour_left a")
        assert tab.locator("#scenario-table tbody tr").count() == 3
        tab.locator("#scenario-table button.play").nth(1).click()
        tab.wait_for_selector("#scene-facts div")
        title = tab.text_content("#scene-title")
        tab.keyboard.press("ArrowRight")
        tab.wait_for_function("old => document.getElementById('scene-title').textContent !== old", arg=title)
        assert "tsbench scenarios open detour_left-" in tab.inner_text("#scene-facts")
        tab.wait_for_function("tsb.sceneBev.drawings.length === 2")
        tab.keyboard.press("Escape")
        assert not tab.locator("#scene").is_visible()
        tab.wait_for_function("Boolean(tsb.placeMap)")
        tab.evaluate("const m = tsb.placeMap, p = m.places.used[0]; m.pick(...m.px(p.x, p.y))")
        assert tab.locator("#map-told button").count() >= 1
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
