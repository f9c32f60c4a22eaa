"""Standard output and standard error that survive: closed ones, full ones, readers that have gone, plain ASCII."""

from __future__ import annotations

import codecs
import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console

STDOUT = "standard output"
_PLAIN = {**dict.fromkeys("–—−‐─━╌╸╺", "-"), **dict.fromkeys("│┃", "|"), "×": "x", "…": "~", "•": "*", "→": ">"}


class _Output(io.FileIO):
    """A stream's file descriptor. The first write that fails raises an OSError with the stream's name as its file.

    name: None for a stream that nothing depends on: its first failed write raises nothing. What is written after the
    first failure is dropped.
    """

    def __init__(self, fd: int, name: str | None) -> None:
        super().__init__(fd, "w", closefd=False)
        self._told, self._gone = name, False

    def write(self, data: Any, /) -> int:
        """Write, as `FileIO` does."""
        if self._gone:
            return len(data)
        try:
            return super().write(data)
        except OSError as problem:
            self._gone = True
            if self._told is None:
                return len(data)
            raise OSError(problem.errno, problem.strerror, self._told) from problem


class _Stream(io.TextIOWrapper):
    """A text stream on a file descriptor; characters that its encoding lacks become plain ones."""

    def __init__(self, fd: int, encoding: str, name: str | None) -> None:
        self._limits = encoding
        # click writes UTF-8 past a stream that says it takes ASCII.
        plain = codecs.lookup(encoding).name == "ascii"
        super().__init__(
            io.BufferedWriter(_Output(fd, name)), "utf-8" if plain else encoding, line_buffering=os.isatty(fd)
        )

    def write(self, text: str) -> int:
        """Write what of the text the encoding has, and stand-ins for the rest; the length of the text."""
        super().write(text.encode(self._limits, _HANDLER).decode(self._limits))
        return len(text)


@contextmanager
def standard_streams() -> Iterator[None]:
    """Streams for a command: a closed one takes all and keeps nothing; errors of stderr never end what is done.

    Streams that replace the process's own stay.
    """
    _open_closed()
    before = sys.stdout, sys.stderr
    if sys.stdout is sys.__stdout__:
        sys.stdout = _Stream(1, _encoding(sys.stdout), STDOUT)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _Stream(2, _encoding(sys.stderr), None)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def progress_console() -> Console:
    """Standard error, for what may get lost: a run goes on where nobody can be told of it any more."""
    # Imported here: `--help` needs none.
    from rich.console import Console

    own = sys.stderr is sys.__stderr__ and sys.stderr is not None
    return Console(file=_Stream(2, _encoding(sys.stderr), None)) if own else Console(stderr=True)


def _encoding(stream: TextIO | None) -> str:
    return getattr(stream, "encoding", None) or "utf-8"


def _open_closed() -> None:
    """Give closed descriptors a place: the next file that is opened would get their number, and what is printed."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _stand_in(problem: UnicodeError) -> tuple[str, int]:
    assert isinstance(problem, UnicodeEncodeError)
    lacking = problem.object[problem.start : problem.end]
    return "".join(map(_plain, lacking)), problem.end


def _plain(character: str) -> str:
    bare = unicodedata.normalize("NFKD", character)[:1]
    return _PLAIN.get(character) or (bare if bare.isascii() else "?")


_HANDLER = "tsbench.plain"
codecs.register_error(_HANDLER, _stand_in)
