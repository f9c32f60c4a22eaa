"""Which source files a module consists of: itself and what it imports from chosen packages, directly or not.

Read from the text, so nothing is imported; an import inside a function counts too.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).resolve().parent


def closure(starts: Sequence[Path], within: Sequence[str]) -> tuple[Path, ...]:
    """Files of the modules `starts` and of all that they import below the packages `within`, sorted by path.

    within: dotted names, such as "tsbench.planners". What stands elsewhere is not followed.
    """
    found: set[Path] = set()
    todo = [path.resolve() for path in starts]
    while todo:
        path = todo.pop()
        if path in found:
            continue
        found.add(path)
        todo += [_file(name) for name in _imports(path) if _below(name, within)]
    return tuple(sorted(found))


@cache
def _imports(path: Path) -> tuple[str, ...]:
    """Dotted names of the modules of tsbench that a file imports."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return tuple(dict.fromkeys(name for node in ast.walk(tree) for name in _named(node) if _is_module(name)))


def _named(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _is_module(name: str) -> bool:
    return name.partition(".")[0] == "tsbench" and _file(name).is_file()


def _file(name: str) -> Path:
    base = _ROOT.joinpath(*name.split(".")[1:])
    # As Python does: a folder without __init__.py (data) does not hide the module of its name.
    package = base / "__init__.py"
    return package if package.is_file() else base.with_suffix(".py")


def _below(name: str, within: Sequence[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in within)
