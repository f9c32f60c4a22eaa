"""Packages: what the installed tsbench asks for, and the versions that are known to work together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.tools.doctor.finding import REPAIR, Diagnosis, Status, installed

if TYPE_CHECKING:
    from packaging.requirements import Requirement

_FOR_DEVELOPERS = ("build", "dev", "mutation")


def check_packages() -> Iterator[Diagnosis]:
    """What the installed tsbench asks for, and the versions that are known to work together."""
    try:
        asked = requires("tsbench") or []
    except PackageNotFoundError:
        yield Diagnosis(Status.FAILED, "packages", "tsbench itself is not installed", REPAIR)
        return
    lock = Path(__file__).resolve().parents[3] / "requirements.lock"
    pins = locked(lock.read_text(encoding="utf-8")) if lock.is_file() else []
    yield from judge_packages(asked, pins, installed(_names((*asked, *pins))))


def locked(text: str) -> list[str]:
    """The requirement lines of a lock file, without their hashes."""
    return [line.rstrip(" \\") for line in text.splitlines() if line[:1].isalnum()]


def judge_packages(
    asked: Iterable[str], pins: Sequence[str], there: Mapping[str, str]
) -> Iterator[Diagnosis]:
    """asked: requirement lines with markers; pins: of a clone's lock file. there: version by package name."""
    from packaging.requirements import Requirement

    core, extras = list[Requirement](), dict[str, list[Requirement]]()
    for line in asked:
        requirement = Requirement(line)
        marker = str(requirement.marker or "")
        extra = marker.partition('extra == "')[2].partition('"')[0]
        (extras.setdefault(extra, []) if extra else core).append(requirement)
    wrong = _unmet(core, there)
    if wrong:
        yield Diagnosis(Status.FAILED, "packages", f"not as required: {', '.join(wrong)}", REPAIR)
    else:
        yield Diagnosis(Status.OK, "packages", f"all {len(core)} required packages are there")
    for extra, wanted in sorted(extras.items()):
        if extra in _FOR_DEVELOPERS and not pins:
            continue
        wrong = _unmet(wanted, there)
        text = f"extra {extra}: " + (f"lacks {', '.join(wrong)}" if wrong else "complete")
        remedy = f"only if you need it: pip install 'tsbench[{extra}]'" if wrong else ""
        yield Diagnosis(Status.NOTE if wrong else Status.OK, "packages", text, remedy)
    pinned = [r for r in map(Requirement, pins) if r.marker is None or r.marker.evaluate()]
    other = [f"{r.name} {there[r.name]} instead of {r.specifier}" for r in pinned
             if r.name in there and not r.specifier.contains(there[r.name], prereleases=True)]  # fmt: skip
    if other:
        text = f"other versions than those known to work together: {', '.join(other)}"
        yield Diagnosis(Status.NOTE, "packages", text, f"if something fails: {REPAIR}")


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

    return [Requirement(line).name for line in lines]
