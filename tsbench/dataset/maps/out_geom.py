"""Overpass's `out geom` and `out center`: XML whose ways and members repeat the places of their nodes.

libosmium reads neither, and with `out geom` alone there are no nodes in the file.
"""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path

from lxml import etree

from tsbench.dataset.maps.names import ending_of, occurs, opened_xml
from tsbench.dataset.maps.plain_xml import elements

_GEOMETRY = re.compile(rb"""<center\s|<nd\s[^<>]*\blat\s*=""")
# What a plain file has within its objects.
_PARTS = ("nd", "member", "tag")


def has_geometry(path: Path) -> bool:
    """Does an extract repeat places in this way?"""
    return not ending_of(path.name).endswith("pbf") and occurs(_GEOMETRY, path)


def with_nodes(path: Path) -> bytes:
    """Its XML as `out body` writes it, then the nodes that stand in its ways only."""
    nodes: set[str | None] = set()
    places: dict[str, etree._Element] = {}
    made = BytesIO()
    with (
        opened_xml(path) as stream,
        etree.xmlfile(made, encoding="UTF-8") as file,
        file.element("osm", version="0.6"),
    ):
        for element in elements(stream, ("node", "way", "relation")):
            if element.tag == "node":
                nodes.add(element.get("id"))
            for part in list(element):
                if part.tag not in _PARTS:
                    element.remove(part)
                    continue
                del part[:]
                name, lat, lon = (part.get(key) for key in ("ref", "lat", "lon"))
                if part.tag == "nd" and name and lat is not None and lon is not None:
                    places.setdefault(name, etree.Element("node", id=name, lat=lat, lon=lon))
            file.write(element, with_tail=False)
        for name, node in places.items():
            if name not in nodes:
                file.write(node)
    return made.getvalue()
