"""Who imports whom in tsbench, read from the text of its files.

`LAYERS` is the house's order, from the top down: imports go down it only. Packages of one layer may import each other,
as long as no files go in circles.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import tsbench

ROOT = Path(tsbench.__file__).parent
# Each package with its place from the left in the picture.
LAYERS: tuple[dict[str, float], ...] = (
    {"cli": 1.5, "api": 3.5},
    {"bridges": 0.5, "board": 2.5},
    {"learn": 0.5, "make": 2.5},
    {"report": 1.5},
    {"run": 1.5},
    {"metrics": 1.5},
    {"episode": 1.5},
    {"planners": 0.5, "rules": 2.5},
    {"scenarios": 1.5},
    {"sim": 1.5},
    {"roads": 1.5, "signs": 3.0},
    {"geometry": 2.15},
    {"core": 1.5},
)
LAYER = {package: number for number, layer in enumerate(LAYERS) for package in layer}


@cache
def modules() -> dict[str, Path]:
    """Dotted names of all modules of tsbench and their files."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports() -> dict[str, tuple[str, ...]]:
    """Who imports what: for each module the modules of tsbench that it names."""
    return {name: tuple(one for one in _imported(path) if one in modules()) for name, path in modules().items()}


def _imported(path: Path) -> list[str]:
    """What a file imports anywhere, but for the reader of types only."""
    found, statements = list[str](), list[ast.stmt](ast.parse(path.read_text(encoding="utf-8")).body)
    for node in statements:
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert not node.level, f"{path}: relative import"
            found += [_module_of(node.module, alias.name) for alias in node.names]
        elif not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
            # Imports stand in statements, never in expressions.
            blocks = (getattr(node, name, ()) for name in ("body", "orelse", "finalbody", "handlers", "cases"))
            statements += [inner for block in blocks for inner in block]
    return found


def _module_of(module: str, name: str) -> str:
    return f"{module}.{name}" if f"{module}.{name}" in modules() else module


def package_of(module: str) -> str:
    """The layer's package of a module; "" for tsbench itself, which shows the public names of all, and its command."""
    return module.split(".")[1] if "." in module and module != "tsbench.__main__" else ""
