"""Packages: what the installed tsbench asks for, and the versions that are known to work together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.run.doctor.finding import Finding, Status, installed

if TYPE_CHECKING:
    from packaging.requirements import Requirement


def check_packages() -> Iterator[Finding]:
    """What the installed tsbench asks for, and the versions that are known to work together."""
    try:
        asked = requires("tsbench") or []
    except PackageNotFoundError:
        yield Finding(Status.FAILED, "packages", "tsbench itself is not installed", "make setup")
        return
    pins = Path(__file__).resolve().parents[3] / "constraints.txt"
    lines = pins.read_text(encoding="utf-8").splitlines() if pins.is_file() else []
    yield from judge_packages(asked, lines, installed(_names((*asked, *lines))))


def judge_packages(asked: Iterable[str], pins: Iterable[str], there: Mapping[str, str]) -> Iterator[Finding]:
    """asked: requirement lines with markers; pins: of constraints.txt; there: version by package name."""
    from packaging.requirements import Requirement

    core, extras = list[Requirement](), dict[str, list[Requirement]]()
    for line in asked:
        requirement = Requirement(line)
        marker = str(requirement.marker or "")
        extra = marker.partition('extra == "')[2].partition('"')[0]
        (extras.setdefault(extra, []) if extra else core).append(requirement)
    wrong = _unmet(core, there)
    if wrong:
        yield Finding(Status.FAILED, "packages", f"not as required: {', '.join(wrong)}", "make setup")
    else:
        yield Finding(Status.OK, "packages", f"all {len(core)} required packages are there")
    for extra, wanted in sorted(extras.items()):
        wrong = _unmet(wanted, there)
        text = f"extra {extra}: " + (f"lacks {', '.join(wrong)}" if wrong else "complete")
        remedy = f"only if you need it: pip install -c constraints.txt -e '.[{extra}]'" if wrong else ""
        yield Finding(Status.NOTE if wrong else Status.OK, "packages", text, remedy)
    pinned = [Requirement(line) for line in pins if line.strip() and not line.startswith("#")]
    other = [f"{r.name} {there[r.name]} instead of {r.specifier}" for r in pinned
             if r.name in there and not r.specifier.contains(there[r.name], prereleases=True)]  # fmt: skip
    if other:
        text = f"other versions than those known to work together: {', '.join(other)}"
        yield Finding(Status.NOTE, "packages", text, "if something fails: make setup")


def _unmet(wanted: Iterable[Requirement], there: Mapping[str, str]) -> list[str]:
    """What is not there, or of another version than asked for."""
    found = []
    for r in wanted:
        if r.name not in there:
            found.append(f"{r.name} (not there)")
        elif not r.specifier.contains(there[r.name], prereleases=True):
            found.append(f"{r.name} {there[r.name]} ({r.specifier})")
    return found


def _names(lines: Iterable[str]) -> list[str]:
    from packaging.requirements import Requirement

    return [Requirement(line).name for line in lines if line.strip() and not line.startswith("#")]
