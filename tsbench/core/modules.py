"""A folder of modules that nothing lists: a file that lies in it is part of it."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType


def import_all(package: str) -> Mapping[str, ModuleType]:
    """The modules of a package, by their names in it, sorted.

    Where the package is written out in the call, all of them belong to what its file depends on (`core.provenance`).
    """
    folder = import_module(package).__path__
    return {one.name: import_module(f"{package}.{one.name}") for one in pkgutil.iter_modules(folder)}
