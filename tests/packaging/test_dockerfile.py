"""The Dockerfile agrees with what it copies, with the page on installing and with pyproject.toml."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
PAGE = (ROOT / "docs/install.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


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


def test_its_python_is_one_that_the_project_takes() -> None:
    (version,) = re.findall(r"^FROM python:([\d.]+)-slim$", DOCKERFILE, re.M)
    least = re.fullmatch(r">=([\d.]+)", PROJECT["requires-python"])
    assert least is not None
    assert tuple(map(int, version.split("."))) >= tuple(map(int, least[1].split(".")))
    assert f"Python {least[1]} or later" in PAGE


def test_its_extras_are_those_that_the_page_names() -> None:
    (extras,) = re.findall(r'^ARG EXTRAS="(.*)"$', DOCKERFILE, re.M)
    assert extras.split() == ["report", "video"]
    assert set(extras.split()) <= set(PROJECT["optional-dependencies"])
    assert "the extras `report` and `video`" in " ".join(PAGE.split())
    assert all(extra in PROJECT["optional-dependencies"] for extra in re.findall(r'EXTRAS="(\w+)', PAGE))


def test_it_runs_the_command_in_the_mounted_folder() -> None:
    assert re.search(r'^ENTRYPOINT \["tsbench"\]$', DOCKERFILE, re.M)
    (folder,) = set(re.findall(r':(/\w+)" tsbench', PAGE + DOCKERFILE))
    assert re.findall(r"^WORKDIR (\S+)$", DOCKERFILE, re.M)[-1] == folder
