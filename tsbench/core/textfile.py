"""Text, JSON and YAML files from users; an error is one clear line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from tsbench.core.errors import InputError
from tsbench.core.text import fault_in_texts

# Far more than any of ours has.
_MOST_BYTES = 1 << 26
_DEEPEST = 50


def read_text(path: Path, what: str) -> str:
    """A file of UTF-8 text. Raises InputError; `what` says what it should be."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise InputError(f"{path}: larger than {_MOST_BYTES >> 20} MiB: cannot be a {what}")
        return content.decode()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: no {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read as a {what} (byte {error.start} is not UTF-8)") from None


def read_json(path: Path, what: str) -> Any:
    """The content of a JSON file. Raises InputError; `what` says what it should be."""
    try:
        content = json.loads(read_text(path, what))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None
    if fault := _fault_in_depth(content) or fault_in_texts(content):
        raise InputError(f"{path}: cannot be read as a {what} ({fault})")
    return content


def _fault_in_depth(content: Any) -> str:
    level = [content]
    for _ in range(_DEEPEST):
        level = [
            inner
            for one in level
            if isinstance(one, dict | list)
            for inner in (one.values() if isinstance(one, dict) else one)
        ]
        if not level:
            return ""
    return f"more than {_DEEPEST} levels deep"


class _UniqueKeyLoader(yaml.CSafeLoader):
    """The safe loader, but a key that stands twice is an error and not a silent overwrite."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise yaml.MarkedYAMLError(problem=f"key {key.value!r} twice", problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file. Raises InputError; `what` says what it should be."""
    text = read_text(path, what)
    try:
        _check_depth(path, text)
        return _UniqueKeyLoader(text).get_single_data()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or " ".join(str(error).split())
        raise InputError(f"{path}: {line}{problem or 'not YAML'}") from None
    except (ValueError, TypeError) as error:
        # An impossible date, a number without an end, a mapping as a key.
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None


def _check_depth(path: Path, text: str) -> None:
    """The reader goes down with the content, and ends the process where that is too deep."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise InputError(f"{path}: more than {_DEEPEST} levels deep")
