"""Reading SUMO's XML files, plain or gzip, up to a size: one clear line for whatever is wrong with one."""

from __future__ import annotations

import gzip
import hashlib
import zlib
from pathlib import Path

from lxml import etree

from tsbench.core.errors import InputError

_GZIP = b"\x1f\x8b"
# The largest networks that are read (of whole cities) have a few hundred.
_MOST_BYTES = 1 << 30


def read_plain(path: Path, what: str) -> bytes:
    """A file's content, uncompressed if it is gzip. Raises InputError; `what` says what it should be."""
    try:
        with path.open("rb") as raw:
            packed = raw.read(len(_GZIP)) == _GZIP
            raw.seek(0)
            # Read to the limit and no further: how large it will be unpacked stands nowhere that can be trusted.
            data = (gzip.GzipFile(fileobj=raw) if packed else raw).read(_MOST_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}") from None
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None
    if len(data) > _MOST_BYTES:
        raise InputError(f"{path}: more than {_MOST_BYTES >> 20} MiB unpacked: too large for a {what}")
    return data


def parse(data: bytes, path: Path, tag: str, what: str) -> etree._Element:
    """The root element of a file's content. Raises InputError (file, line) where it is no XML or not a `<tag>`."""
    try:
        root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path}: line {error.lineno}: not a well-formed {what} ({error.msg})") from None
    if root.tag != tag:
        raise InputError(f"{path}: line 1: <{root.tag}> is not a {what} (expected <{tag}>)")
    return root


def sha256(data: bytes) -> str:
    """SHA-256 (hex): of uncompressed content, so that it does not depend on a compressor's version."""
    return hashlib.sha256(data).hexdigest()
