"""What made this: the one answer to which code, data and versions something depends on.

Code is a *closure*: the files that running a module can import, directly or not, read from their text, so nothing is
imported. An import inside a function counts, and so do all modules of a package that `core.modules.import_all` names;
an import under TYPE_CHECKING does not. Every package on the way counts with its `__init__`, and so does a data file
that a string of the code names. Installed packages are not followed: their versions are asked for. Python counts by
its syntax tree: comments, docstrings and layout change no digest.
"""

from __future__ import annotations

import ast
import hashlib
import json
import sys
import sysconfig
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib.machinery import all_suffixes
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tsbench.core.files import sha256_of
from tsbench.core.paths import data_file

# SHA-256 (hex) of files, by name as in "package/module.py": below the folder that they are imported from.
Files = dict[str, str]

# What decides the bytes of an episode beside tsbench. What a processor makes of it is no version and stands elsewhere.
DECIDING = ("libsumo", "numpy", "scipy", "shapely")
DATA_SUFFIXES = frozenset(
    (
        ".bin", ".ckpt", ".csv", ".h5", ".joblib", ".json", ".model", ".msgpack", ".npy", ".npz", ".onnx", ".parquet",
        ".pickle", ".pkl", ".pt", ".pth", ".safetensors", ".toml", ".xml", ".yaml", ".yml", ".zip",
    )
)  # fmt: skip
_ROOT = Path(__file__).resolve().parents[2]
_OURS = "tsbench"
_INSTALLED = ("site-packages", "dist-packages")
_LONGEST_NAME = 255
# What may import a module.
_IMPORTING = frozenset((ast.Import, ast.ImportFrom, ast.Call))


def digest(value: Any) -> str:
    """SHA-256 (hex) of what JSON can hold; dictionaries in any order."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, ensure_ascii=True).encode("ascii")).hexdigest()


def data_hash(rows: Iterable[Any], signs: Sequence[Mapping[str, Any]]) -> str:
    """SHA-256 (hex) over the fields of rows (dataclasses), in any order, and what the catalogue says of signs.

    A field that holds its default counts for nothing: a new one changes no old row.
    """
    each = sorted(digest(_told(row)) for row in rows)
    return digest({"rows": each, "signs": list(signs)})


def _told(row: Any) -> dict[str, Any]:
    return {f.name: value for f in fields(row) if (value := getattr(row, f.name)) != f.default}


def versions(packages: Iterable[str] = DECIDING) -> dict[str, str | None]:
    """Installed versions of packages, None for what is not there."""
    return {name: _version(name) for name in packages}


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def closure(starts: Iterable[str | Path], without: Collection[str] = ()) -> Files:
    """The files of `closure_paths` with their hashes. Raises OSError for one that cannot be read."""
    found = _find(starts, without)
    return {name: digest or sha256_of(path) for name, (path, digest) in found.items()}


def closure_paths(starts: Iterable[str | Path], without: Collection[str] = ()) -> dict[str, Path]:
    """Where the files lie of the modules `starts` and of all that they import, by name as in `Files`.

    starts: dotted names of tsbench's modules, or files. without: names of files that are neither counted nor
    followed, as they stand in the result. Modules are looked for beside a start, beside its topmost package, in
    tsbench, and on Python's path where nothing is installed. Raises OSError for a start that cannot be read.
    """
    return {name: path for name, (path, _) in _find(starts, without).items()}


# The file of each name, and the digest of what it says; None for data, which is not read here.
_Found = dict[str, tuple[Path, str | None]]


def _find(starts: Iterable[str | Path], without: Collection[str]) -> _Found:
    found: _Found = {}
    for start in starts:
        path = start if isinstance(start, Path) else _ROOT.joinpath(*start.split(".")).with_suffix(".py")
        _Search(path.resolve(), without).follow(found)
    return found


class _Search:
    """Finds the files of modules as an import from `start` does."""

    def __init__(self, start: Path, without: Collection[str]) -> None:
        self._start, self._without = start, without
        self._top = start.parent
        while (self._top / "__init__.py").is_file():
            self._top = self._top.parent
        self._places = list(dict.fromkeys([self._top, start.parent, _ROOT, *_own_places()]))
        # Where packages are installed, only tsbench and the package that was asked for are followed.
        self._followed = {_OURS, start.relative_to(self._top).with_suffix("").parts[0]}
        self._known: dict[str, list[tuple[Path, Path]]] = {}

    def follow(self, found: _Found) -> None:
        around = ".".join(self._start.relative_to(self._top).with_suffix("").parts)
        todo = [(self._start, self._top), *self._files_of(around)]
        while todo:
            path, place = todo.pop()
            name = path.relative_to(place).as_posix()
            if name in found or name in self._without:
                continue
            code = _read(path.read_bytes(), path.suffix)
            found[name] = path, code.digest
            for text in code.data:
                # tsbench's own data is looked up as data; what a planner loads may be named from where a run began.
                named = data_file(text) if name.startswith(f"{_OURS}/") else Path.cwd() / text
                data = next((place for place in (path.parent / text, named) if place.is_file()), None)
                if data is not None and f"{name}: {text}" not in self._without:
                    found[f"{name}: {text}"] = data, None
            for module, level in code.imports:
                todo += self._files_of(_absolute(module, level, name))

    def _files_of(self, module: str) -> list[tuple[Path, Path]]:
        """(file, the place it is below) of a dotted name: its packages and itself; [] for what is not followed.

        With `.*` at its end: all modules of the package.
        """
        if module not in self._known:
            self._known[module] = self._look_for(module)
        return self._known[module]

    def _look_for(self, module: str) -> list[tuple[Path, Path]]:
        if module.endswith(".*"):
            files = self._files_of(module[:-2])
            return files + [(path, files[-1][1]) for path in sorted(files[-1][0].parent.glob("*.py"))]
        first = module.partition(".")[0]
        for place in self._places:
            if place.name in _INSTALLED and first not in self._followed:
                continue
            files, base = [], place
            for part in module.split("."):
                base = base / part
                file = _module_file(base)
                if file is not None:
                    files.append((file, place))
                elif not base.is_dir():
                    break
            if files:
                return files
        return []


@lru_cache(maxsize=4096)
def _module_file(base: Path) -> Path | None:
    """The file of a module, as Python finds it: a folder without __init__.py (data) does not hide a module."""
    package = base / "__init__.py"
    names = [package, *(base.with_name(base.name + suffix) for suffix in all_suffixes())]
    return next((path for path in names if path.is_file()), None)


def _own_places() -> list[Path]:
    """Folders of the path that hold people's own modules: not Python's own, nor what is installed."""
    standard = {Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")}
    places = [Path(entry).resolve() for entry in sys.path if Path(entry).is_dir()]
    return [p for p in places if p.name not in _INSTALLED and not standard & {p, *p.parents}]


def _absolute(module: str, level: int, name: str) -> str:
    """The dotted name of an import in the file `name`; level: dots that it begins with."""
    if not level:
        return module
    package = name.split("/")[:-level]
    return ".".join([*package, *([module] if module else [])])


@dataclass(frozen=True, slots=True)
class _Code:
    """imports: (dotted name, level). data: strings that may name data files. digest: of what the code says."""

    imports: tuple[tuple[str, int], ...]
    data: tuple[str, ...]
    digest: str


@lru_cache(maxsize=1024)
def _read(content: bytes, suffix: str) -> _Code:
    """What a file says. One that is no Python of this version (an extension, say) counts by its bytes."""
    if suffix == ".py":
        try:
            return _read_tree(ast.parse(content))
        except (SyntaxError, ValueError):
            pass
    return _Code((), (), hashlib.sha256(content).hexdigest())


def _read_tree(tree: ast.Module) -> _Code:
    imports: dict[tuple[str, int], None] = {}
    strings: dict[str, None] = {}
    words: list[str] = []
    _tell(tree, words, imports, strings)
    text = "\n".join(words).encode("utf-8", "surrogatepass")
    return _Code(tuple(imports), tuple(strings), hashlib.sha256(text).hexdigest())


def _tell(
    node: ast.AST, words: list[str], imports: dict[tuple[str, int], None], strings: dict[str, None],
    runs: bool = True,
) -> None:  # fmt: skip
    """Write a tree down in a way that is the same for all versions of Python, without docstrings and places.

    `ast.dump` is not: newer versions have more fields and leave out others. Here a field counts if it holds
    something. runs: is this code that runs, so that its imports count?
    """
    kind = type(node)
    words.append(kind.__name__)
    if runs and kind in _IMPORTING:
        for one in _imported(node):
            imports[one] = None
    unchecked = runs and not (isinstance(node, ast.If) and _names_type_checking(node.test))
    for name in kind._fields:
        value = getattr(node, name, None)
        if value is None:
            continue
        items: Iterable[Any] = (value,)
        if isinstance(value, list):
            items = list(_joined(value)) if kind is ast.JoinedStr else value
            if name == "body":
                items = [line for line in value if not _is_bare_text(line)]
            if not items:
                continue
        words.append(f".{name}")
        for item in items:
            if isinstance(item, ast.AST):
                _tell(item, words, imports, strings, unchecked if name == "body" else runs)
                continue
            # Not repr: which characters it shows as they are depends on Python's version of Unicode.
            words.append(ascii(item))
            if runs and isinstance(item, str) and "." in item and _suffix(item) in DATA_SUFFIXES:
                strings[item] = None
        words.append(";")


def _suffix(name: str) -> str:
    return Path(name[-_LONGEST_NAME:]).suffix


def _imported(node: ast.AST) -> Iterator[tuple[str, int]]:
    """(dotted name, level) of the modules that one statement or call imports."""
    if isinstance(node, ast.Import):
        yield from ((alias.name, 0) for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        module = node.module or ""
        yield module, node.level
        yield from ((f"{module}.{alias.name}" if module else alias.name, node.level) for alias in node.names)
    elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if called in ("import_module", "__import__", "import_all") and isinstance(node.args[0].value, str):
            yield node.args[0].value + (".*" if called == "import_all" else ""), 0


def _joined(parts: Iterable[ast.expr]) -> Iterator[ast.expr]:
    """Parts of an f-string; Python 3.12 leaves texts apart that others join."""
    text = ""
    for part in parts:
        if isinstance(part, ast.Constant):
            text += str(part.value)
            continue
        if text:
            yield ast.Constant(text)
        text = ""
        yield part
    if text:
        yield ast.Constant(text)


def _is_bare_text(node: ast.AST) -> bool:
    """A docstring, or another string that stands for itself."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _names_type_checking(test: ast.AST) -> bool:
    return (test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", "")) == "TYPE_CHECKING"
