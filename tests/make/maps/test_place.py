"""A place by its name: what the geocoder answers becomes the outline that Overpass is asked for."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from typing import Any
from urllib.parse import parse_qs, urlparse

import osmnx
import pytest
from command_line import one_line
from serving import answer, serving

from tsbench.core.errors import InputError
from tsbench.make.maps.extracts import check_outline, query
from tsbench.make.maps.own_extract import outline_of

SQUARE = [[11.5, 49.9], [11.6, 49.9], [11.6, 50.0], [11.5, 50.0], [11.5, 49.9]]
SMALL = [[12.0, 50.0], [12.01, 50.0], [12.01, 50.01], [12.0, 50.0]]


def place(kind: str, coordinates: Any) -> dict[str, Any]:
    return {
        "importance": 0.5, "lat": "49.95", "lon": "11.55", "boundingbox": ["49.9", "50.0", "11.5", "11.6"],
        "display_name": "Here", "geojson": {"type": kind, "coordinates": coordinates},
    }  # fmt: skip


class Nominatim(BaseHTTPRequestHandler):
    """Answers every question with `answer`."""

    answer: Any = None
    asked: list[str] = []  # noqa: RUF012

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        self.asked.append(parse_qs(urlparse(self.path).query)["q"][0])
        content = self.answer if isinstance(self.answer, bytes) else json.dumps(self.answer).encode()
        answer(self, content)


@pytest.fixture
def geocoder(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(Nominatim, "asked", [])
    # It waits a second before each question, for the public server's sake.
    monkeypatch.setattr(osmnx._nominatim.time, "sleep", lambda _: None)
    with serving(Nominatim) as there:
        yield f"{there}/"


def test_the_largest_part_of_a_place_is_asked_for(geocoder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Nominatim, "answer", [place("MultiPolygon", [[SMALL], [SQUARE]])])
    outline = outline_of("Here, Germany", geocoder)
    assert Nominatim.asked == ["Here, Germany"]
    assert set(outline) == {(lon, lat) for lon, lat in SQUARE}
    assert len(outline) == 4, "the first corner is not repeated"
    asked = query(outline, "2024-02-29")
    assert '(poly:"' in asked
    assert "49.90000 11.50000" in asked, "latitude first"


def test_a_long_outline_is_made_short(geocoder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    around = [k * math.tau / 5000 for k in range(5000)]
    circle = [[11.5 + 0.1 * math.cos(a), 49.9 + 0.05 * math.sin(a)] for a in around]
    monkeypatch.setattr(Nominatim, "answer", [place("Polygon", [[*circle, circle[0]]])])
    outline = outline_of("Round", geocoder)
    assert 20 < len(outline) <= 150
    assert outline == outline_of("Round", geocoder)
    assert all(abs(math.hypot((lon - 11.5) / 0.1, (lat - 49.9) / 0.05) - 1.0) < 0.02 for lon, lat in outline)


@pytest.mark.parametrize("answer", [[], [place("Point", [11.5, 49.9])], {"error": "no"}, b"<html>busy</html>"])
def test_what_is_no_place_is_one_line(geocoder: str, monkeypatch: pytest.MonkeyPatch, answer: Any) -> None:
    monkeypatch.setattr(Nominatim, "answer", answer)
    with one_line(match=r"--place Nowhere: .* has no outline of it|cannot be asked"):
        outline_of("Nowhere", geocoder)


def test_no_geocoder_is_one_line(geocoder: str) -> None:
    with pytest.raises(InputError, match=r"^http://127\.0\.0\.1:9/: cannot be asked"):
        outline_of("Here", "http://127.0.0.1:9/")


def test_a_country_is_too_large() -> None:
    with pytest.raises(InputError, match=r"--place Germany: larger than 1\.5 degrees"):
        check_outline("Germany", ((6.0, 47.0), (15.0, 47.0), (15.0, 55.0)))
