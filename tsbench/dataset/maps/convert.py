"""An OSM extract to one SUMO network, or to plain XML, as `sumo_nets/netconvert/` says."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.dataset.maps.netconvert import run_netconvert
from tsbench.dataset.maps.osm import ExtractFacts, read_extract
from tsbench.dataset.maps.paths import netconvert_file

TIMEOUT_S = 900.0


def convert_extract(extract: Path, out: Path) -> ExtractFacts:
    """Convert an extract to the network `out` (`.net.xml` or `.net.xml.gz`)."""
    if not out.name.endswith((".net.xml", ".net.xml.gz")):
        raise InputError(f"{out}: the network's name must end in .net.xml or .net.xml.gz")
    return _netconvert(extract, out, "--output-file")


def convert_to_plain(extract: Path, prefix: Path) -> ExtractFacts:
    """Convert an extract to plain XML files `prefix.nod.xml`, `prefix.edg.xml` (and others)."""
    return _netconvert(extract, prefix, "--plain-output-prefix")


def _netconvert(extract: Path, out: Path, option: str) -> ExtractFacts:
    with tempfile.TemporaryDirectory(prefix="tsbench-osm-") as folder:
        plain = Path(folder) / "extract.osm"
        facts = read_extract(extract, plain)
        out.parent.mkdir(parents=True, exist_ok=True)
        arguments = [
            *("--configuration-file", str(netconvert_file("extract.netccfg"))),
            *("--type-files", str(netconvert_file("moscow.typ.xml"))),
            *("--osm-files", str(plain)),
            *(option, str(out)),
        ]
        run_netconvert(arguments, what=str(extract), timeout_s=TIMEOUT_S)
    return facts
