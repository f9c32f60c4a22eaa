"""CITATION.cff: what citation tools read, by the schema of the format, and of this version."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

import tsbench

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = json.loads((Path(__file__).parent / "cff-1.2.0.schema.json").read_text(encoding="utf-8"))


@pytest.fixture
def citation() -> dict[str, Any]:
    told = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    return json.loads(json.dumps(told, default=str))  # the format's dates are text


def problems(citation: dict[str, Any]) -> list[str]:
    validator = jsonschema.Draft7Validator(SCHEMA, format_checker=jsonschema.Draft7Validator.FORMAT_CHECKER)
    return [error.message for error in validator.iter_errors(citation)]


def test_it_is_valid_and_of_this_version(citation: dict[str, Any]) -> None:
    assert problems(citation) == []
    assert citation["version"] == tsbench.__version__
    assert citation["license"] == "MIT"
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith("MIT License")


def test_the_readme_cites_the_same(citation: dict[str, Any]) -> None:
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    entry = dict(re.findall(r"^  (\w+) += \{+(.*?)\}+,$", page, re.M))
    (author,) = citation["authors"]
    assert entry == {
        "author": author["name"],
        "title": citation["title"],
        "year": citation["date-released"][:4],
        "version": citation["version"],
    }
    for project in (ROOT / "pyproject.toml", ROOT / "packaging/tsbench-data/pyproject.toml"):
        told = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
        assert told["authors"] == [author]
        assert (project.parent / told["readme"]).is_file()
