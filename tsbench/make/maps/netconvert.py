"""Runs SUMO's netconvert from the wheel, on extracts and on a `PlainNet`; the user needs no SUMO_HOME.

A `PlainNet` becomes a `.net.xml(.gz)`, the same bytes each time.
"""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from lxml import etree

from tsbench.core.errors import InputError
from tsbench.core.files import replacing, write_atomic
from tsbench.core.paths import LEFT
from tsbench.make.city import load_city, netconvert_file, types_file
from tsbench.make.maps.osm import ExtractFacts, read_extract
from tsbench.make.maps.plain import (
    PlainConnection,
    PlainCrossing,
    PlainEdge,
    PlainNet,
    PlainNode,
    origins_and_junctions,
)
from tsbench.make.maps.road_tags import some
from tsbench.make.maps.utm import UtmFrame
from tsbench.scenarios.data_set import DataSet

EXTRACT_TIMEOUT_S = 900.0
# Warnings that a tag was not taken as it is; the others are about the making of junctions, stops and restrictions.
_OF_TAGS = re.compile(
    "Value of key|Skipping edge|Using default width|Using minimum lane number|New value for oneway"
    "|Unknown lane use|Discarding edge"
)
# That coordinates are not moved to the origin is meant so; totals come after the first five of a kind.
_SAID_ALWAYS = re.compile(r"Network contains very large coordinates|\d+ total messages of type")
# What differs between two warnings of one kind.
_VALUES = re.compile(r"'.*'|\(.*\)|-?\d+(\.\d+)?")
TIMEOUT_S = 300.0
# netconvert writes a comment with the time and the temporary paths of the run: no data.
_HEADER_COMMENT = re.compile(rb"<!-- generated on .*?-->\s*", re.DOTALL)


def sumo_home() -> Path:
    """Where the wheel with SUMO's programs and their data lies."""
    import sumo  # an extra: only who makes networks needs it

    return Path(sumo.SUMO_HOME)


def sumo_binary(name: str) -> Path:
    return sumo_home() / "bin" / name


def sumo_environment() -> dict[str, str]:
    """The environment of a SUMO child process: its own data folders, everything else as it is here."""
    home = sumo_home()
    proj = str(home / "data" / "proj")
    return {**os.environ, "SUMO_HOME": str(home), "PROJ_DATA": proj, "PROJ_LIB": proj}


def run_netconvert(
    data: DataSet, folder: Path, configuration: str, arguments: Sequence[str], *, what: str, timeout_s: float
) -> str:
    """Run netconvert in a folder and return what it said on stderr; `what` names the input in the error line.

    The arguments name files by their names in the folder: netconvert splits names at commas and drops spaces, so it
    never sees a path of the user's. configuration: a file of `sumo_nets/netconvert/`, read with the city's type map.
    The binary itself is called: the wheel's console script costs 100 ms of Python start-up on top.
    """
    for name, file in (("netccfg", netconvert_file(configuration)), ("typ.xml", types_file(data))):
        (folder / f"tsbench.{name}").symlink_to(file.resolve())
    own = ("--configuration-file", "tsbench.netccfg", "--type-files", "tsbench.typ.xml")
    try:
        done = subprocess.run(
            [str(sumo_binary("netconvert")), *own, *arguments],
            cwd=folder,
            env=sumo_environment(),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as slow:
        raise InputError(f"{what}: netconvert did not finish within {timeout_s:.0f} s") from slow
    if done.returncode != 0:
        raise InputError(f"{what}: netconvert failed ({done.returncode}): {_last_error(done.stderr)}")
    return done.stderr


def convert_extract(data: DataSet, extract: Path, out: Path) -> ExtractFacts:
    """Convert an extract to the network `out` (`.net.xml` or `.net.xml.gz`), as `sumo_nets/netconvert/` says.

    Where traffic keeps to the left in the city it does so in the network, unlike in `convert_to_plain`.
    """
    if not out.name.endswith((".net.xml", ".net.xml.gz")):
        raise InputError(f"{out}: the network's name must end in .net.xml or .net.xml.gz")
    with tempfile.TemporaryDirectory(prefix="tsbench-osm-") as folder:
        built = Path(folder) / ("built.net.xml.gz" if out.suffix == ".gz" else "built.net.xml")
        side = ("--lefthand", "true") if load_city(data.name).side == LEFT else ()
        facts = _convert(data, extract, Path(folder), ("--output-file", built.name), *side, in_mirror=False)
        with replacing(out) as part:
            shutil.copyfile(built, part)
    return facts


def convert_to_plain(data: DataSet, extract: Path, folder: Path) -> ExtractFacts:
    """Convert an extract to plain XML files of a folder: `net.nod.xml`, `net.edg.xml` (and others).

    Where traffic keeps to the left in the city, the files are of the image in a mirror.
    """
    return _convert(
        data, extract, folder, ("--plain-output-prefix", "net"), in_mirror=load_city(data.name).frame.mirrored
    )


def _convert(
    data: DataSet, extract: Path, folder: Path, output: tuple[str, str], *options: str, in_mirror: bool
) -> ExtractFacts:
    facts = read_extract(extract, folder / "extract.osm", in_mirror)
    projection = UtmFrame(facts.zone).projection
    arguments = ("--osm-files", "extract.osm", "--proj", projection, *output, *options)
    said = run_netconvert(data, folder, "extract.netccfg", arguments, what=str(extract), timeout_s=EXTRACT_TIMEOUT_S)
    (folder / "extract.osm").unlink()
    warnings = _kinds(said)
    of_tags = [line for line in warnings if _OF_TAGS.match(line)]
    option, name = output
    built = [folder / name] if option == "--output-file" else [folder / f"{name}.{k}.xml" for k in ("nod", "edg")]
    notes = (*facts.notes, *(f"netconvert: {line}" for line in of_tags), *_lost_roads(facts, built))
    others = tuple(f"netconvert: {line}" for line in warnings if line not in of_tags)
    return replace(facts, notes=notes, warnings=others)


def _lost_roads(facts: ExtractFacts, built: Sequence[Path]) -> list[str]:
    """A line for the roads that no edge was made of; those that lie within one junction are part of it."""
    edges, junctions = origins_and_junctions(built)
    lost = [
        f"way {way}"
        for way, (first, last) in sorted(facts.road_ends.items())
        if way not in edges and (first not in junctions or junctions[first] != junctions.get(last))
    ]
    if not lost:
        return []
    return [
        f"{len(lost):,} of {facts.roads:,} roads for cars are not in the network, because cars may not use them, their "
        f"nodes are missing or they are as short as a junction: {some(lost)}"
    ]


def _kinds(stderr: str) -> list[str]:
    """netconvert's warnings, the first of each kind and how many like it."""
    first: dict[str, str] = {}
    count: Counter[str] = Counter()
    for line in stderr.splitlines():
        text = line.strip().removeprefix("Warning: ")
        if not line.startswith("Warning: ") or _SAID_ALWAYS.match(text):
            continue
        kind = _VALUES.sub("", text)
        first.setdefault(kind, text)
        count[kind] += 1
    return [text + (f" (and {count[kind] - 1} like it)" if count[kind] > 1 else "") for kind, text in first.items()]


def _last_error(stderr: str) -> str:
    """The last two error lines of netconvert's output, on one line."""
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")] or lines
    return " | ".join(errors[-2:]) if errors else "it said nothing"


def build_net(plain: PlainNet, out: Path) -> None:
    """Build a network; `out` ends in `.net.xml` or `.net.xml.gz`. InputError if netconvert refuses it."""
    with tempfile.TemporaryDirectory(prefix="tsbench-net-") as name:
        folder = Path(name)
        arguments = [*write_plain(plain, folder), "--output-file", "built.net.xml"]
        run_netconvert(plain.data, folder, "crop.netccfg", arguments, what=out.name, timeout_s=TIMEOUT_S)
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
    return _element("crossing", node=crossing.node, edges=edges, priority=True, width=crossing.width)
