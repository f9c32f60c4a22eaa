"""Under `make mutation`: in a process that tries a mutant, all other functions of the rules are called directly.

mutmut (3.8) puts a switch before every function, which looks up the mutant at each call: three quarters of these
tests' time. A mutant is tried in a fork that ends with it, so nothing is put back. In CI this does nothing.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterator
from types import FunctionType

RULES = "tsbench.rules."


def _namespaces() -> Iterator[object]:
    """The modules of the rules, and the classes that they define."""
    for name in sorted(name for name in sys.modules if name.startswith(RULES)):
        module = sys.modules[name]
        yield module
        yield from (x for x in vars(module).values() if inspect.isclass(x) and x.__module__ == name)


def _mangled(function: Callable[..., object]) -> str:
    """mutmut's name for a function: `<module>.x_<name>`, or `<module>.xǁ<class>ǁ<name>`."""
    of_class, _, name = function.__qualname__.rpartition(".")
    return f"{function.__module__}.{f'xǁ{of_class}ǁ' if of_class else 'x_'}{name}"


def pytest_collection_finish() -> None:
    """Once the test modules have imported the rules."""
    mutated, is_mutant, _ = os.environ.get("MUTANT_UNDER_TEST", "").partition("__mutmut_")
    if not is_mutant:
        return
    for namespace in _namespaces():
        for name, switch in list(vars(namespace).items()):
            plain = getattr(switch, "__wrapped__", None)
            if not isinstance(plain, FunctionType) or not plain.__module__.startswith(RULES):
                continue
            if _mangled(plain) != mutated:
                setattr(namespace, name, plain)
