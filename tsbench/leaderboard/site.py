"""The leaderboard as a static site: an index of rows by contract, and a page for each submission."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.paths import using_city
from tsbench.core.textfile import read_json
from tsbench.leaderboard.submission import KIND as SUBMISSION
from tsbench.leaderboard.submission import Figure, Submission, figures_of, read_submission
from tsbench.leaderboard.verify import KIND as VERIFICATION
from tsbench.leaderboard.verify import Verification, read_verification
from tsbench.metrics.records import CONTRASTED, PAIRED, SIGNED_ONES
from tsbench.report.page.shell import render_page
from tsbench.run.contract import contract_hash
from tsbench.scenarios.table import read_table, splits_there, table_path
from tsbench.signs.catalog import load_catalog

_INDEX = "index.html"
_HALVES = (SIGNED_ONES, CONTRASTED)
_SCRIPTS = ("leaderboard.js",)


@dataclass(frozen=True)
class Row:
    """A submission as the site shows it. page: file name; checked: its figures were computed again here."""

    submission: Submission
    page: str
    sha256: str
    checked: bool
    verifications: list[Verification] = field(default_factory=list)

    @property
    def refuted(self) -> bool:
        return any(not found.confirmed for found in self.verifications)

    @property
    def flags(self) -> list[str]:
        s = self.submission
        told = {
            "floor": s.planner.floor,
            "third-party": s.third_party,
            "isolated": s.isolation is not None and bool(s.isolation.get("namespaces")),
            "privileged": s.planner.privileged,
            "reads no plates": not s.planner.sign_access and not s.planner.floor,
        }
        return [name for name, holds in told.items() if holds]

    def figure(self, name: str, over: str = "all") -> Figure | None:
        return next((f for f in self.submission.figures if (f.figure, f.over) == (name, over)), None)

    @property
    def rank_by(self) -> tuple[bool, float, str]:
        """Refuted rows last, then by paired SCD; of a data set without pairs by signed SCD."""
        first = self.figure(PAIRED) or self.figure(_HALVES[0])
        value = -1.0 if first is None or first.value is None else first.value
        return self.refuted, -value, self.submission.title


def build_site(folder: Path, out: Path) -> int:
    """Write the site of all submissions and verifications below a folder; how many rows it has.

    Raises InputError: a JSON file of another kind, a verification of no submission that is there, or a submission whose
    figures do not follow from its episodes (where its data are here).
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of submissions")
    rows = _rows(folder)
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.rank_by):
        s = row.submission
        groups.setdefault((s.edition, s.split, s.contract), []).append(row)
    shown = [_group(key, groups[key]) for key in sorted(groups, key=lambda k: (-len(groups[k]), k))]
    pages = {
        _INDEX: render_page("leaderboard.html", title="tsbench leaderboard", scripts=_SCRIPTS, groups=shown)
    }
    for row in rows:
        pages[row.page] = render_page(
            "leaderboard_row.html", title=row.submission.title, scripts=_SCRIPTS, row=row, types=_types(row),
            failures=_failures(row.submission), short=_short,
        )  # fmt: skip
    with io_errors_as_input_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        for name, text in pages.items():
            write_atomic(out / name, text.encode())
    return len(rows)


def _rows(folder: Path) -> list[Row]:
    rows: dict[str, Row] = {}
    records: list[tuple[Path, Verification]] = []
    for path in sorted(folder.rglob("*.json")):
        data = read_json(path, "submission or record of a verification")
        kind = data.get("kind") if isinstance(data, dict) else None
        if kind == SUBMISSION:
            submission = read_submission(path)
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            name = re.sub(r"[^A-Za-z0-9]+", "-", submission.title).strip("-").lower() or "row"
            rows[digest] = Row(submission, f"{name}-{digest[:8]}.html", digest, _check(path, submission))
        elif kind == VERIFICATION:
            records.append((path, read_verification(path)))
        else:
            raise InputError(f"{path}: neither a submission nor the record of a verification")
    for path, record in records:
        if record.submission_sha256 not in rows:
            raise InputError(f"{path}: is of a submission that is not below {folder}, or was changed since")
        rows[record.submission_sha256].verifications.append(record)
    return list(rows.values())


def _check(path: Path, submission: Submission) -> bool:
    """Do the figures follow from the episodes? False where the data of its contract are not here."""
    with using_city(submission.city):
        if submission.split not in splits_there():
            return False
        table = read_table(table_path(submission.split))
        if contract_hash(table, load_catalog()) != submission.contract:
            return False
        found = figures_of(submission.episodes, table, submission.planner, submission.contract)
    if found != submission.figures:
        wrong = next(
            (f"{a.figure} of {a.over}" for a in found if a not in submission.figures), "their number"
        )
        raise InputError(
            f"{path}: its figures do not follow from its episodes ({wrong}): it is no submission of tsbench"
        )
    return True


def _group(key: tuple[str, str, str], rows: Sequence[Row]) -> dict[str, Any]:
    """The rows of one contract with the panels that any of them has."""
    edition, split, contract = key
    primary = PAIRED if any(row.figure(PAIRED) for row in rows) else _HALVES[0]
    groups = dict.fromkeys(kind.group for kind in load_catalog().types)
    panels = [g for g in groups if any(row.figure(primary, g) for row in rows)]
    figures = [name for name in (PAIRED, *_HALVES) if any(row.figure(name) for row in rows)]
    return {
        "title": f"{edition}, {split} split", "contract": contract, "figures": figures, "primary": primary,
        "panels": panels, "rows": rows,
    }  # fmt: skip


def _types(row: Row) -> list[tuple[str, list[Figure | None]]]:
    """Each type with its figures: paired, signed, contrast."""
    catalog = load_catalog()
    names = (PAIRED, *_HALVES)
    return [(kind.id, [row.figure(name, kind.id) for name in names]) for kind in catalog.types]


def _failures(submission: Submission) -> list[tuple[str, int]]:
    """Clauses, and outcomes that are no arrival, with how many episodes have them, the most frequent first."""
    found: Counter[str] = Counter()
    for episode in submission.episodes:
        found.update(episode.clauses)
        if episode.outcome != "arrived":
            found[f"outcome: {episode.outcome}"] += 1
    return sorted(found.items(), key=lambda item: (-item[1], item[0]))


def _short(value: object) -> str:
    return value[:12] if isinstance(value, str) else "–"
