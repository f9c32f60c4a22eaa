"""Rows of the leaderboard: submissions below a folder, each with the verifications of it, checked as they are read."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from statistics import mean, stdev

from confusable_homoglyphs.confusables import confusables_data

from tsbench.board.submission import KIND as SUBMISSION
from tsbench.board.submission import Figure, Submission, figures_of, read_submission
from tsbench.board.verification import KIND as VERIFICATION
from tsbench.board.verification import ClaimVerdict, Verification, draw, read_verification
from tsbench.core.errors import InputError
from tsbench.core.provenance import digest
from tsbench.core.textfile import read_json
from tsbench.metrics.scd import EVERY_PART
from tsbench.planners.registry import comes_with_tsbench
from tsbench.run.edition import LOCAL, contract_now, edition_of, standing_contract
from tsbench.scenarios.data_set import DataSet

_SHORT = 8
# Long enough that no code is found by trial that has the number of somebody else's.
_OF_PLANNER = 16
# What a planner's name ends with that learned from another seed.
_SEED = re.compile(r"-seed\d+$")
# File names of `BoardRow.page`, and of older ones.
PAGE = re.compile(rf"[a-z0-9]+(-[a-z0-9]+)*-[0-9a-f]{{{_SHORT},{_OF_PLANNER}}}\.html")


@dataclass(frozen=True)
class BoardRow:
    """A submission as the site shows it. path: of its file; sha256: of what it says.

    checked: the data of its contract are here, and its figures were computed again.
    """

    submission: Submission
    path: Path
    sha256: str
    checked: bool
    verifications: list[Verification] = field(default_factory=list)

    @property
    def refuted(self) -> bool:
        return any(found.verdict is ClaimVerdict.REFUTED for found in self.verifications)

    @property
    def flags(self) -> list[str]:
        s = self.submission
        told = {
            "not checked": not self.checked,
            "floor": s.planner.floor,
            "third-party": s.third_party,
            "isolated": s.isolation is not None and bool(s.isolation.get("namespaces")),
            "shared process": s.isolation is None,
            "privileged": s.planner.privileged,
            "reads no plates": not s.planner.sign_access and not s.planner.floor,
        }
        return [name for name, holds in told.items() if holds]

    @property
    def planner_id(self) -> str:
        """Equal for submissions of one planner: by name, code, files and weights; of tsbench's own by name and weights.

        Where nothing is hashed, each submission is a planner of its own.
        """
        p = self.submission.planner
        hashes = [p.code_sha256, p.weights_sha256, *p.files]
        known = any(hashes) or comes_with_tsbench(p.spec)
        return digest([p.name, *(hashes if known else [self.sha256])])[:_OF_PLANNER]

    @property
    def page(self) -> str:
        """File name of the page of its planner."""
        name = re.sub(r"[^A-Za-z0-9]+", "-", self.submission.planner.name).strip("-").lower() or "planner"
        return f"{name}-{self.planner_id}.html"

    @property
    def anchor(self) -> str:
        """Where on that page it stands."""
        return f"s-{self.sha256[:_SHORT]}"

    @cached_property
    def data_set(self) -> tuple[str, str, str]:
        """Edition, split, contract: what rows must have in common to be compared.

        The edition is that of the contract. Where nobody here knows it, and its data are not here, that is said.
        """
        s = self.submission
        edition = edition_of(s.contract, s.edition, DataSet.named(s.city))
        if edition.endswith(LOCAL):
            edition = s.edition if self.checked else f"{s.edition} (unknown contract)"
        return edition, s.split, standing_contract(s.contract)

    @property
    def level_rank(self) -> tuple[float, str, str]:
        """Of its perception level: exact first, then by the share that is read right. Equal for equal levels only."""
        level = self.submission.perception
        return (-2.0, "", "") if level is None else (-level.right, level.name, digest(asdict(level)))

    def figure(self, name: str, over: str = "all") -> Figure | None:
        return next((f for f in self.submission.figures if (f.figure, f.over) == (name, over)), None)

    @property
    def primary(self) -> Figure | None:
        """Squared SCD of scenes with two signs, else paired SCD; of a data set without pairs signed SCD."""
        return next(filter(None, map(self.figure, EVERY_PART)), None)

    @property
    def rank_by(self) -> tuple[bool, float, str]:
        """Refuted rows last, then by the primary figure."""
        first = self.primary
        value = -1.0 if first is None or first.value is None else first.value
        return self.refuted, -value, self.submission.title


@dataclass(frozen=True)
class SeedRows:
    """Seeds of one planner: rows of one data set, level and authors that are called `NAME`, `NAME-seed1`, …; no floors.

    rows: of each seed the one to show; two at least, none refuted. submitted: all of them.
    """

    name: str
    rows: tuple[BoardRow, ...]
    submitted: tuple[BoardRow, ...]

    def figure(self, name: str, over: str = "all") -> tuple[float, float] | None:
        """Mean and standard deviation, %, None where a row has no such figure."""
        found = [row.figure(name, over) for row in self.rows]
        values = [f.value for f in found if f is not None and f.value is not None]
        return (mean(values), stdev(values)) if len(values) == len(self.rows) else None


def seeds_of(rows: Iterable[BoardRow]) -> list[SeedRows]:
    """Of rows of one data set and level."""
    found: dict[tuple[str, str], dict[str, list[BoardRow]]] = {}
    for row in rows:
        s = row.submission
        if not (row.refuted or s.planner.floor):
            name = _SEED.sub("", s.planner.name)
            found.setdefault((name, s.authors), {}).setdefault(s.planner.name, []).append(row)
    return [
        SeedRows(name, tuple(map(latest, own.values())), tuple(chain.from_iterable(own.values())))
        for (name, _), own in found.items()
        if len(own) > 1
    ]


def latest(rows: Iterable[BoardRow]) -> BoardRow:
    """The row to show where a planner was submitted more than once: an unrefuted one, then the last."""
    return max(rows, key=lambda row: (not row.refuted, row.submission.finished, row.sha256))


def read_rows(folder: Path) -> list[BoardRow]:
    """All submissions below a folder with their verifications.

    Raises InputError: no such folder, a JSON file of another kind, a verification of no submission that is there, a
    submission whose figures do not follow from its episodes (where its data are here), or two planners with names that
    look alike.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of submissions")
    rows: dict[str, BoardRow] = {}
    records: list[tuple[Path, Verification]] = []
    for path in sorted(folder.rglob("*.json")):
        if path.is_symlink() or not path.is_file():
            raise InputError(f"{path}: is no regular file: a submission or a record is")
        data = read_json(path, "submission or record of a verification")
        kind = data.get("kind") if isinstance(data, dict) else None
        if kind == SUBMISSION:
            submission = read_submission(path)
            if other := rows.get(submission.sha256):
                raise InputError(f"{path}: says what {other.path} says: remove one of them")
            rows[submission.sha256] = BoardRow(submission, path, submission.sha256, _check(path, submission))
        elif kind == VERIFICATION:
            records.append((path, read_verification(path)))
        else:
            raise InputError(f"{path}: neither a submission nor the record of a verification")
    for path, record in records:
        if record.submission_sha256 not in rows:
            raise InputError(f"{path}: is of a submission that is not below {folder}, or was changed since")
        row = rows[record.submission_sha256]
        if strange := {*record.driven} - {episode.scenario_id for episode in row.submission.episodes}:
            raise InputError(f"{path}: says that {min(strange)} was driven, of which {row.path} has no episode")
        if row.checked and list(record.driven) != _drawn(row.submission, record):
            raise InputError(f"{path}: seed {record.seed} draws other episodes than it says were driven")
        row.verifications.append(record)
    _check_names(rows.values())
    return list(rows.values())


def _drawn(s: Submission, record: Verification) -> list[str]:
    table = DataSet.named(s.city).table(s.split)
    return [spec.scenario_id for spec in draw(s.contract, s.episodes, table, record.sample, record.seed)]


def _check_names(rows: Iterable[BoardRow]) -> None:
    """Raises InputError where readers take one planner's name for another's."""
    seen: dict[str, tuple[str, BoardRow]] = {}
    for row in rows:
        for name in {row.submission.planner.name, row.submission.title}:
            other, first = seen.setdefault(skeleton(name), (name, row))
            if other != name and first.planner_id != row.planner_id:
                raise InputError(
                    f"{row.path}: {name!a} looks like {other!a} of {first.path}: one of them needs another name"
                )


def _check(path: Path, submission: Submission) -> bool:
    """Do the figures follow from the episodes? False where the data of its contract are not here."""
    data = DataSet.named(submission.city)
    if submission.split not in data.splits:
        return False
    table = data.table(submission.split)
    if standing_contract(contract_now(data, submission.split)) != standing_contract(submission.contract):
        return False
    found = figures_of(submission.episodes, table, submission.planner, submission.contract)
    if found != submission.figures:
        wrong = next((f"{a.figure} of {a.over}" for a in found if a not in submission.figures), "their number")
        raise InputError(
            f"{path}: its figures do not follow from its episodes ({wrong}): it is no submission of tsbench"
        )
    return True


def skeleton(name: str) -> str:
    """Equal for names that readers take for one another; for comparison only."""
    return "".join(map(_plainest, unicodedata.normalize("NFD", name)))


@cache
def _plainest(character: str) -> str:
    """What stands for all characters that look like this one."""
    alike = _alike(character)
    # A character that has many is the one that stands for them.
    if len(alike) != 1:
        return character
    (other,) = alike
    return other if len(_alike(other)) > 1 else min(character, other)


def _alike(character: str) -> list[str]:
    return [str(one["c"]) for one in confusables_data.get(character, ())]
