"""What made this: which code, data and versions something depends on.

Code is a *closure*: the files that running a module can import, directly or not, read from their text, so nothing is
imported. An import inside a function counts, and so do all modules of a package that `core.errors.import_all` names;
an import under TYPE_CHECKING does not. Every package on the way counts with its `__init__`, and so does a data file
that a string of the code names. Installed packages are not followed: their versions are asked for. tsbench is followed
only from its own modules: elsewhere its scoring number speaks for it (`run.edition`). Each file counts by its bytes.
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

from tsbench.core.errors import InputError
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
# Of all files of a closure, and of a module whose imports are looked for.
MOST_BYTES = 8 << 30
_MOST_SOURCE_BYTES = 1 << 20
_ROOT = Path(__file__).resolve().parents[2]
_OURS = "tsbench"
_INSTALLED = ("site-packages", "dist-packages")
_LONGEST_NAME = 255


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
    """The files of `closure_paths` with their hashes.

    Raises OSError for a file that cannot be read, InputError for more than `MOST_BYTES` in all.
    """
    paths = closure_paths(starts, without)
    sizes = {name: path.stat().st_size for name, path in paths.items()}
    left = MOST_BYTES
    for name, path in paths.items():
        left -= sizes[name]
        if left < 0:
            raise InputError(f"{path}: with it the planner's files have more than {MOST_BYTES >> 30} GiB")
    return {name: _sha256(path, sizes[name]) for name, path in paths.items()}


def _sha256(path: Path, size: int) -> str:
    """SHA-256 (hex) of the first bytes of a file: what grows, or is a window into the kernel, does not keep it busy."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while size and (piece := file.read(min(size, 1 << 20))):
            found.update(piece)
            size -= len(piece)
    return found.hexdigest()


def closure_paths(starts: Iterable[str | Path], without: Collection[str] = ()) -> dict[str, Path]:
    """Where the files lie of the modules `starts` and of all that they import, by name as in `Files`.

    starts: dotted names of tsbench's modules, or files. without: names of files that are neither counted nor
    followed, as they stand in the result. Modules are looked for beside a start, beside its topmost package, in
    tsbench, and on Python's path where nothing is installed. A data file counts where it lies, links followed, in the
    place of the code that names it or in the current folder. Raises OSError for a start that cannot be read.
    """
    found: dict[str, Path] = {}
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
        self._ours = start.is_relative_to(_ROOT / _OURS)
        self._places = list(dict.fromkeys([self._top, start.parent, _ROOT, *_own_places()]))
        # Where packages are installed, only tsbench and the package that was asked for are followed.
        self._followed = {_OURS, start.relative_to(self._top).with_suffix("").parts[0]}
        self._known: dict[str, list[tuple[Path, Path]]] = {}

    def follow(self, found: dict[str, Path]) -> None:
        around = ".".join(self._start.relative_to(self._top).with_suffix("").parts)
        todo = [(self._start, self._top), *self._files_of(around)]
        while todo:
            path, place = todo.pop()
            name = path.relative_to(place).as_posix()
            if name in found or name in self._without:
                continue
            found[name] = path
            code = _read(path)
            for text in code.data:
                data = self._data(text, path, name)
                if data is not None and f"{name}: {text}" not in self._without:
                    found[f"{name}: {text}"] = data
            for module, level in code.imports:
                todo += self._files_of(_absolute(module, level, name))

    def _data(self, text: str, path: Path, name: str) -> Path | None:
        """The data file that a string in a module names; None if it names no file."""
        # tsbench's own data is looked up as data; what a planner loads may be named from where a run began.
        named = data_file(text) if name.startswith(f"{_OURS}/") else Path.cwd() / text
        for candidate in (path.parent / text, named):
            real = candidate.resolve()
            inside = self._ours or any(real.is_relative_to(place) for place in (self._top, Path.cwd()))
            if inside and real.is_file():
                return real
        return None

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
        if first == _OURS and not self._ours:
            return []
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
    """imports: (dotted name, level). data: strings that may name data files."""

    imports: tuple[tuple[str, int], ...] = ()
    data: tuple[str, ...] = ()


def _read(path: Path) -> _Code:
    """What a module imports and names; nothing where the file is no Python of this version (an extension, say)."""
    size = path.stat().st_size
    if path.suffix != ".py" or not 0 < size <= _MOST_SOURCE_BYTES:
        return _Code()
    with path.open("rb") as file:
        return _parsed(file.read(size))


@lru_cache(maxsize=1024)
def _parsed(content: bytes) -> _Code:
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        # Python does not import it either.
        return _Code()
    imports: dict[tuple[str, int], None] = {}
    strings: dict[str, None] = {}
    todo: list[ast.AST] = [tree]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str) and _names_data(node.value):
                strings[node.value] = None
            continue
        imports.update(dict.fromkeys(_imported(node)))
        if isinstance(node, ast.If) and _names_type_checking(node.test):
            todo += node.orelse
            continue
        todo += (child for child in ast.iter_child_nodes(node) if not _is_bare_text(child))
    return _Code(tuple(imports), tuple(strings))


def _names_data(text: str) -> bool:
    # What is not printable is no UTF-8, or no name that a file system takes.
    short = len(text) <= _LONGEST_NAME and text.isprintable() and len(text.encode()) <= _LONGEST_NAME
    return short and Path(text).suffix in DATA_SUFFIXES


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


def _is_bare_text(node: ast.AST) -> bool:
    """A docstring, or another string that stands for itself."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _names_type_checking(test: ast.AST) -> bool:
    return (test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", "")) == "TYPE_CHECKING"
