"""All checks in turn. Each says what it saw in plain words, and what to do where it is not as it should be.

What can crash or takes much memory (SUMO, torch) is looked at in a process of its own. Packages are imported inside the
checks: the doctor must speak where one is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from tsbench.core.errors import InputError
from tsbench.tools.doctor.data import check_data, check_edition, check_sumo
from tsbench.tools.doctor.finding import Diagnosis, Status
from tsbench.tools.doctor.machine import check_gpu, check_machine, check_python, check_tools
from tsbench.tools.doctor.packages import check_packages

CHECKS: Mapping[str, Callable[[], Iterator[Diagnosis]]] = {
    "Python": check_python,
    "packages": check_packages,
    "SUMO": check_sumo,
    "data": check_data,
    "edition": check_edition,
    "machine": check_machine,
    "tools": check_tools,
    "torch": check_gpu,
}


def examine() -> Iterator[Diagnosis]:
    """All checks in turn; each is done when it is asked for."""
    for name, check in CHECKS.items():
        try:
            yield from check()
        except InputError as problem:
            yield Diagnosis(Status.FAILED, name, str(problem))
        except ImportError as problem:
            yield Diagnosis(
                Status.FAILED, name, f"cannot be checked: {problem}", "install the missing package"
            )
