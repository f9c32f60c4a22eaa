"""The contract hash: the fingerprint of everything that must be equal for two scores to be comparable."""

from __future__ import annotations

import base64
import subprocess
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import tsbench
from tsbench.core.files import sha256_of
from tsbench.core.provenance import data_hash, digest, versions
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.signs.catalog import Catalog

# Version of what the code makes of scenes: records, events and traces, tsbench's own planners included. A change of one
# byte raises it; tests/test_golden.py fails until then.
SCORING = 3

_PACKAGE = Path(tsbench.__file__).resolve().parent
_CODE = frozenset((".py", ".yaml", ".json", ".csv"))


def contract_hash(rows: Sequence[ScenarioSpec], catalog: Catalog) -> str:
    """SHA-256 (hex) over the scoring number, the rows, their signs with rules, and versions of packages.

    Rows hold the hashes of their scene files. The arithmetic of a processor is no part of it: `run.json` records it.
    The contract of a mirrored data set follows from that of the data set that it mirrors.
    """
    if catalog.image is not None:
        stored = [mirrored_row(row, catalog.image) for row in rows]
        return mirrored_contract(contract_hash(stored, catalog.image))
    contrast = any(row.half == CONTRAST for row in rows)
    rules = catalog.contract_entries((row.sign_code for row in rows), contrast)
    return digest({"scoring": SCORING, "data": data_hash(rows, rules), "versions": versions()})


def mirrored_contract(contract: str) -> str:
    """The contract of a data set's mirror image, by its own."""
    return digest({"mirrored": contract})


@cache
def code_hash() -> str:
    """SHA-256 (hex) of the files of tsbench's package: code, and settings beside it."""
    return digest({path.relative_to(_PACKAGE).as_posix(): sha256_of(path) for path in _code_files()})


def code_stamps() -> dict[Path, tuple[int, int]]:
    """Size and time of the last change, ns, of each file of the package: others once a file was written."""
    return {path: ((found := path.stat()).st_size, found.st_mtime_ns) for path in _code_files()}


def _code_files() -> list[Path]:
    return sorted(path for path in _PACKAGE.rglob("*") if path.suffix in _CODE and path.is_file())


@cache
def code_is_local() -> bool:
    """Does the package differ from what was released?

    An installed package is compared with the hashes that its wheel came with, a clone with its last commit. Of a copy
    that is neither nothing is known, and it counts as changed.
    """
    released = _released_hashes()
    if released:
        there = {path.relative_to(_PACKAGE).as_posix(): path for path in _code_files()}
        return any(name not in released or _recorded(path) != released[name] for name, path in there.items())
    root = _PACKAGE.parent
    if not (root / ".git").exists():
        return True
    command = ["git", "-C", str(root), "status", "--porcelain", "--", _PACKAGE.name]
    try:
        return bool(subprocess.run(command, capture_output=True, timeout=10, check=True).stdout.strip())
    except (OSError, subprocess.SubprocessError):
        return True


def _released_hashes() -> dict[str, str]:
    """Hashes of the package's files in the RECORD of an installed wheel; {} for a clone."""
    prefix = f"{_PACKAGE.name}/"
    try:
        listed = files(_PACKAGE.name) or []
    except PackageNotFoundError:
        return {}
    own = {file.as_posix(): file for file in listed if file.as_posix().startswith(prefix)}
    init = own.get(f"{prefix}__init__.py")
    if init is None or Path(str(init.locate())).resolve() != _PACKAGE / "__init__.py":
        return {}
    return {name.removeprefix(prefix): file.hash.value for name, file in own.items() if file.hash is not None}


def _recorded(path: Path) -> str:
    """SHA-256 as RECORD has it: base64 for URLs, without padding."""
    return base64.urlsafe_b64encode(bytes.fromhex(sha256_of(path))).rstrip(b"=").decode()
