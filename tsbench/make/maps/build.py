"""Builds a `PlainNet` to a `.net.xml(.gz)` with netconvert, the same bytes each time."""

from __future__ import annotations

import gzip
import re
import tempfile
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from lxml import etree

from tsbench.core.files import write_atomic
from tsbench.make.maps.netconvert import run_netconvert
from tsbench.make.maps.plain import PlainConnection, PlainCrossing, PlainEdge, PlainNet, PlainNode

TIMEOUT_S = 300.0
# netconvert writes a comment with the time and the temporary paths of the run: no data.
_HEADER_COMMENT = re.compile(rb"<!-- generated on .*?-->\s*", re.DOTALL)


def build_net(plain: PlainNet, out: Path) -> None:
    """Build a network; `out` ends in `.net.xml` or `.net.xml.gz`. InputError if netconvert refuses it."""
    with tempfile.TemporaryDirectory(prefix="tsbench-net-") as name:
        folder = Path(name)
        arguments = [*write_plain(plain, folder), "--output-file", "built.net.xml"]
        run_netconvert(folder, "crop.netccfg", arguments, what=out.name, timeout_s=TIMEOUT_S)
        data = _HEADER_COMMENT.sub(b"", (folder / "built.net.xml").read_bytes(), count=1)
    write_atomic(out, gzip.compress(data, compresslevel=9, mtime=0) if out.suffix == ".gz" else data)


def write_plain(plain: PlainNet, folder: Path) -> list[str]:
    """Write `plain.nod.xml`, `.edg.xml` and, if needed, `.con.xml`; returns netconvert's arguments."""
    nodes, edges, links = "plain.nod.xml", "plain.edg.xml", "plain.con.xml"
    _write(folder / nodes, "nodes", (_node(node) for node in plain.nodes))
    rings = (_ring(ring, plain) for ring in plain.roundabouts)
    _write(folder / edges, "edges", [*(_edge(edge) for edge in plain.edges), *rings])
    # our own files need no validation: reading the schemas costs 40 ms of 140
    arguments = ["--xml-validation", "never", "--node-files", nodes, "--edge-files", edges]
    if plain.connections or plain.crossings:
        crossings = (_crossing(crossing) for crossing in plain.crossings)
        _write(folder / links, "connections", [*(_connection(c) for c in plain.connections), *crossings])
        arguments += ["--connection-files", links]
    return arguments


def _write(path: Path, root: str, elements: Iterable[etree._Element]) -> None:
    tree = etree.Element(root)
    tree.extend(list(elements))
    path.write_bytes(etree.tostring(tree, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _element(tag: str, **attributes: str | float | bool | None) -> etree._Element:
    """An element of the attributes that are neither None nor empty."""
    element = etree.Element(tag)
    for name, value in attributes.items():
        if isinstance(value, bool):
            element.set(name, "true" if value else "false")
        elif value is not None and value != "":
            element.set(name, str(value))
    return element


def _node(node: PlainNode) -> etree._Element:
    return _element("node", id=node.id, x=node.x, y=node.y, type=node.type, rightOfWay=node.right_of_way)


def _edge(edge: PlainEdge) -> etree._Element:
    element = _element(
        "edge", **{"id": edge.id, "from": edge.source, "to": edge.target, "type": edge.type, "name": edge.name},
        numLanes=edge.num_lanes, speed=edge.speed, priority=edge.priority, width=edge.width, spreadType=edge.spread,
        allow=edge.allow, disallow=edge.disallow, shape=" ".join(f"{x:.2f},{y:.2f}" for x, y in edge.shape),
    )  # fmt: skip
    element.extend(_element("lane", **asdict(lane)) for lane in edge.lanes)
    return element


def _ring(ring: tuple[str, ...], plain: PlainNet) -> etree._Element:
    source = {edge.id: edge.source for edge in plain.edges}
    return _element("roundabout", nodes=" ".join(source[edge] for edge in ring), edges=" ".join(ring))


def _connection(link: PlainConnection) -> etree._Element:
    return _element(
        "connection", **{"from": link.source, "to": link.target}, fromLane=link.from_lane, toLane=link.to_lane
    )


def _crossing(crossing: PlainCrossing) -> etree._Element:
    edges = " ".join(crossing.edges)
    return _element("crossing", node=crossing.node, edges=edges, priority=crossing.priority, width=crossing.width)
