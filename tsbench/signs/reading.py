"""Reading a YAML file key by key, so that every problem is one line: file: key: what is wrong."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NoReturn

import yaml

from tsbench.core import textfile
from tsbench.core.errors import InputError

_TOO_BIG = 1e300  # shuts out infinity, and whole numbers that no float can hold


class _UniqueKeyLoader(yaml.CSafeLoader):
    """The safe loader, but a key that stands twice is an error and not a silent overwrite."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                continue
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> "Fields":
    """The mapping at the top of a YAML file.

    Raises:
        InputError: the file is missing, not UTF-8, not YAML, or no mapping.
    """
    content = textfile.read_yaml(path, "sheet of the sign catalogue", _UniqueKeyLoader)
    if not isinstance(content, dict):
        raise InputError(f"{path}: the file must be a mapping of keys")
    return Fields(content, str(path))


class Fields:
    """A mapping that is taken apart key by key; `done` complains about what nobody asked for.

    Each getter raises InputError where the key is missing (unless it has a default) or of the wrong kind.
    """

    def __init__(self, content: Mapping[object, object], where: str) -> None:
        self._content = dict(content)
        self._where = where
        self._asked: set[object] = set()

    def fail(self, key: str, problem: str) -> NoReturn:
        """Raise the one-line error of a key."""
        raise InputError(f"{self._where}: {key}: {problem}")

    def has(self, key: str) -> bool:
        """Whether the key is there with something behind it."""
        self._asked.add(key)
        return self._content.get(key) is not None

    def names(self) -> tuple[str, ...]:
        """All keys in the order of the file."""
        for key in self._content:
            if not isinstance(key, str):
                self.fail(repr(key), "the key must be text (quote it)")
        return tuple(str(key) for key in self._content)

    def done(self) -> None:
        """Raise for a key that no getter asked for."""
        for key in self._content:
            if key not in self._asked:
                raise InputError(f"{self._where}: {key}: unknown key")

    def fields(self, key: str) -> "Fields":
        """A nested mapping."""
        value = self._get(key)
        if not isinstance(value, dict):
            self.fail(key, "must be a mapping")
        return Fields(value, f"{self._where}: {key}")

    def optional_fields(self, key: str) -> "Fields":
        """A nested mapping, empty where the key is missing."""
        return self.fields(key) if self.has(key) else Fields({}, f"{self._where}: {key}")

    def text(self, key: str, among: Iterable[str] | None = None) -> str:
        """A text that is not empty, on request one of a vocabulary."""
        return self._as_text(key, self._get(key), among)

    def texts(self, key: str, among: Iterable[str] | None = None) -> tuple[str, ...]:
        """A list of different texts; may be empty."""
        words = tuple(self._as_text(key, item, among) for item in self._list(key))
        if len(set(words)) < len(words):
            self.fail(key, "an entry stands twice")
        return words

    def words(self, key: str, among: Iterable[str]) -> tuple[str, ...]:
        """One word or a list of at least one."""
        words = self.texts(key, among) if isinstance(self._get(key), list) else (self.text(key, among),)
        if not words:
            self.fail(key, "needs at least one word")
        return words

    def number(self, key: str) -> float:
        """A finite number."""
        return self._as_number(key, self._get(key))

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers."""
        return tuple(self._as_number(key, item) for item in self._list(key))

    def integer(self, key: str) -> int:
        """A whole number of at least 1."""
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            self.fail(key, f"must be a whole number of at least 1, not {value!r}")
        return value

    def optional_integer(self, key: str) -> int | None:
        """A whole number of at least 1, None where the key is missing."""
        return self.integer(key) if self.has(key) else None

    def flag(self, key: str) -> bool:
        """A truth value, False where the key is missing."""
        if not self.has(key):
            return False
        value = self._get(key)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {value!r}")
        return value

    def _get(self, key: str) -> object:
        self._asked.add(key)
        if self._content.get(key) is None:
            self.fail(key, "is missing")
        return self._content[key]

    def _list(self, key: str) -> list[object]:
        value = self._get(key)
        if not isinstance(value, list):
            self.fail(key, "must be a list")
        return value

    def _as_text(self, key: str, value: object, among: Iterable[str] | None) -> str:
        if not isinstance(value, str) or not value.strip():
            self.fail(key, f"must be text, not {value!r} (quote codes and numbers)")
        if among is not None and value not in (words := tuple(among)):
            self.fail(key, f"{value!r} is none of {', '.join(words)}")
        return value

    def _as_number(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _TOO_BIG:
            self.fail(key, f"must be a number, not {value!r}")
        return float(value)
