"""The Dockerfile agrees with what it copies, with the page on installing and with pyproject.toml."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
PAGE = (ROOT / "docs/install.md").read_text(encoding="utf-8")


def packages(text: str, pattern: str) -> set[str]:
    """The names that an apt-get command installs."""
    (found,) = re.findall(pattern, text, re.M)
    return {word for word in found.split() if not word.startswith("-")}


def test_what_it_copies_is_there_and_not_ignored() -> None:
    ignored = set((ROOT / ".dockerignore").read_text(encoding="utf-8").split())
    copied = [name for line in re.findall(r"^COPY (.*) \S+$", DOCKERFILE, re.M) for name in line.split()]
    assert "pyproject.toml" in copied
    for name in copied:
        assert (ROOT / name).exists(), name
        assert not {name, *map(str, Path(name).parents)} - {"."} & ignored, name


def test_the_system_libraries_are_those_of_the_page() -> None:
    image = packages(DOCKERFILE, r"apt-get install (.*?) &&")
    page = packages(PAGE, r"^apt-get install (make .*)$")
    # Python's image has its own way to make environments.
    assert image == page - {"python3-venv"}
