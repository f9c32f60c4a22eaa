"""What an isolated planner prints where no log takes it, shown as text: it may be meant for a terminal to obey."""

from __future__ import annotations

import os
import sys
import threading
from typing import Final

from tsbench.core.text import written_out

# Of one process; what is more is read and dropped.
_MOST_BYTES: Final = 100_000
_LAST_S: Final = 5.0


class Printed:
    """end: a descriptor for a program to print to. Its lines go to this process's standard error, as text."""

    def __init__(self) -> None:
        self._start, self.end = os.pipe()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def close_end(self) -> None:
        """Once programs have it: it ends when they do."""
        os.close(self.end)

    def _read(self) -> None:
        left = _MOST_BYTES
        with os.fdopen(self._start, "rb", buffering=0) as file:
            held = b""
            while piece := file.read(1 << 16):
                held = (held + piece)[: left + 1]
                *lines, held = held.split(b"\n")
                for line in lines:
                    left -= len(line) + 1
                    _show(line)
                if left < len(held):
                    _show(b"(what the planner prints from here on is not shown)")
                    while file.read(1 << 16):
                        pass
                    return
            if held:
                _show(held)

    def wait(self) -> None:
        """Until all that had the end have ended, and everything is shown; for a few seconds at most."""
        self._reader.join(_LAST_S)


def _show(line: bytes) -> None:
    print(written_out(line.decode(errors="replace")), file=sys.stderr, flush=True)
