"""What does not belong in a run folder: moved out of the way with its reason, never deleted, never used."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.files import io_errors_as_input_errors, write_atomic

FOLDER, REASONS = "set_aside", "REASONS.txt"
# Things named one by one on the console; REASONS.txt names all.
_NAMED = 10


class Quarantine:
    """`RUN/set_aside/`: numbered things, and REASONS.txt, which says of each where it was and why it went."""

    def __init__(self, run: Path) -> None:
        self._run, self._folder = run, run / FOLDER
        self._notices: list[str] = []

    def move(self, path: Path, reason: str) -> None:
        """Take something out of the run. Raises InputError if the folder cannot be written."""
        with io_errors_as_input_errors(path):
            target = self._target(path, reason)
            path.rename(target)

    def keep(self, path: Path, content: bytes, reason: str) -> None:
        """Keep a part of a file; its owner takes it out afterwards."""
        with io_errors_as_input_errors(path):
            write_atomic(self._target(path, reason), content)

    def notices(self) -> list[str]:
        """A line for each thing put here since the folder was opened; one for all beyond a few."""
        more = len(self._notices) - _NAMED
        rest = [f"{more} more things set aside: {self._folder / REASONS} names them"] if more > 0 else []
        return [*self._notices[:_NAMED], *rest]

    def _target(self, path: Path, reason: str) -> Path:
        """A free name, its reason written down first: nothing lies there unexplained."""
        self._folder.mkdir(exist_ok=True)
        name = _shown(path.name.lstrip("."))
        number = 1
        while any(self._folder.glob(f"{number}-*")):
            number += 1
        target = self._folder / f"{number}-{name}"
        with (self._folder / REASONS).open("a", encoding="utf-8") as file:
            file.write(f"{target.name}: was {_shown(str(path.relative_to(self._run)))}: {reason}\n")
        self._notices.append(f"{_shown(str(path))}: {reason}; moved to {target}")
        return target


def _shown(name: str) -> str:
    """A name as it may be printed: control characters and broken encodings escaped."""
    return name if name.isprintable() else ascii(name)[1:-1]
