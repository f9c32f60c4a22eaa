"""The few facts of a finished network that the lint needs (`maps.network` reads one for driving)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array


@dataclass(frozen=True, slots=True)
class LaneFacts:
    """One lane outside junctions: its middle line (n, 2), length and width in metres."""

    edge: str
    length: float
    width: float
    line: Array


@dataclass(frozen=True)
class NetFacts:
    """Lanes of the normal edges, and SUMO's direction letter (s, l, r, L, R, t) of each connection."""

    lanes: list[LaneFacts]
    turns: dict[tuple[str, str], str]


def read_net_facts(path: Path) -> NetFacts:
    """Read a `.net.xml` or `.net.xml.gz`."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    try:
        root = etree.parse(str(path), parser).getroot()
    except (OSError, etree.XMLSyntaxError) as broken:
        raise InputError(f"{path}: not a readable network ({' '.join(str(broken).split())})") from broken
    lanes = [
        LaneFacts(
            edge.get("id", ""),
            float(lane.attrib["length"]),
            float(lane.get("width", 3.2)),
            _line(str(lane.attrib["shape"])),
        )
        for edge in root.iterfind("edge")
        if edge.get("function", "normal") == "normal"
        for lane in edge.iterfind("lane")
    ]
    turns = {
        (link.get("from", ""), link.get("to", "")): link.get("dir", "")
        for link in root.iterfind("connection")
        if not link.get("from", "").startswith(":")
    }
    return NetFacts(lanes, turns)


def _line(shape: str) -> Array:
    return np.array([[float(value) for value in point.split(",")[:2]] for point in shape.split()])
