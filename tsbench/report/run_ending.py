"""What a run ends with, on one screen: each planner's headline, and how its episodes failed; and all of its failures.

All figures stand in the run's `summary.md`. A failed episode is one without SCD.
"""

from __future__ import annotations

import shlex
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import tsbench
from tsbench.core.benchmark import TYPES
from tsbench.core.parquet import dicts_of, without
from tsbench.core.text import one_line
from tsbench.episode.outcome import Outcome
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.scd import NAMES
from tsbench.report.analyses.analysis import ALL, DASH
from tsbench.report.analyses.columns import panels_of, present_panels, present_parts
from tsbench.report.wording import readable, sign_words
from tsbench.run.log.read import StoredRun
from tsbench.run.log.record import SPEC_COLUMNS
from tsbench.run.options import BOTH
from tsbench.scenarios.spec import pair_type
from tsbench.signs.countries import Artwork

# Causes of a planner's failures that are told with an example; columns of a terminal, and lines of it for failures.
_MOST_CAUSES, _WIDTH, _LINES = 5, 80, 20
_BIBTEX = """@software{{tsbench,
  author  = {{{{tsbench contributors}}}},
  title   = {{tsbench: a closed-loop benchmark for obeying traffic signs on real road maps}},
  year    = {{2026}},
  version = {{{version}}},
  note    = {{edition {edition}, scoring {scoring}}},
}}"""
# Of a record, all that a failure is told from.
_ENDING = ("outcome", "error", "at_fault", "collision_partner", "duration_s", "route_completion")
_COLUMNS = ("planner", *SPEC_COLUMNS, "scd", "violation_clause", *_ENDING)
# What failures are grouped by, with the field of a failure that it is.
GROUPINGS = MappingProxyType({"planner": "planner", "type": "type", "clause": "cause"})
_ENDS = {
    Outcome.TIMEOUT: "the time was up",
    Outcome.OFF_ROAD: "the ego left the road",
    Outcome.COLLISION: "the ego touched a {partner} ({fault})",
}


def headline(planners: Sequence[PlannerSummary]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table: each planner's primary figure, %, over all types with its interval, and by group."""
    panels, part = present_panels(planners), present_parts(planners)[0]
    rows = []
    for p in planners:
        figures = panels_of(p, part)
        cells = [_text(figures.get(panel), interval=not k) for k, panel in enumerate(panels)]
        rows.append([p.label, *cells])
    return [f"{NAMES[part]}, %", *panels], rows


def _text(figure: StrictAndCompleted[Estimate] | None, *, interval: bool, unit: str = "") -> str:
    found = None if figure is None else figure.main
    if found is None or found.value is None:
        return DASH
    ends = (found.low, found.high) if interval else (None, None)
    told = "" if None in ends else f" ({ends[0]:.1f}{DASH}{ends[1]:.1f})"
    return f"{found.value:.1f}{unit}{told}"


def citation(run: StoredRun, planners: Sequence[PlannerSummary]) -> tuple[list[str], str]:
    """What to say with a run's figures, a line for each planner, and the BibTeX entry of what they were made with."""
    part, effective = present_parts(planners)[0], run.manifest["effective"]
    of = {"city": "", "split": " split", "variants": " variants", "half": " half", "limit": " scenarios at most"}
    words = [f"{value}{what}" for name, what in of.items() if (value := effective.get(name)) not in (None, BOTH)]
    words += ["plates masked"] if run.perception.masked else []
    words += [] if run.perception.level is None else [f"perception {run.manifest['asked']['perception']}"]
    kinds = "" if len(effective["types"]) == TYPES else f"{', '.join(effective['types'])}; "
    scoring = run.manifest.get("scoring", 1)
    said = f"tsbench {run.edition}, {', '.join(words)}; {kinds}scoring {scoring}, contract {run.contract[:12]}"
    lines = []
    for p in planners:
        figure = panels_of(p, part).get(ALL)
        counted = "" if figure is None else f", n = {figure.main.n:,}"
        lines.append(f"{p.label}: {NAMES[part]} {_text(figure, interval=True, unit=' %')}{counted} ({said})")
    return lines, _BIBTEX.format(edition=run.edition, scoring=scoring, version=tsbench.__version__)


@dataclass(frozen=True, slots=True)
class Failure:
    """An episode without SCD. type: of its pair; plate: the code and value of its half's plate; outcome: how it ended.

    cause: "error", else the clause that was broken first, else the outcome. sentence: of what happened.
    """

    planner: str
    scenario_id: str
    type: str
    half: str
    plate: str
    outcome: str
    cause: str
    sentence: str

    @property
    def name(self) -> str:
        """As commands take it."""
        return f"{self.planner}/{self.scenario_id}"


def failures_of(run: StoredRun) -> list[Failure]:
    """A run's failed episodes, by planner in the order of the run and by scenario."""
    place = {name: k for k, name in enumerate(run.asked)}
    episodes = run.episodes.select(_COLUMNS)
    artwork = run.data.artwork()
    found = (_failure(row, run, artwork) for row in dicts_of(without(episodes, "scd")))
    return sorted(found, key=lambda failure: place[failure.planner])


def _failure(row: Mapping[str, Any], run: StoredRun, artwork: Artwork) -> Failure:
    story = run.stories.get((row["planner"], row["scenario_id"]))
    if row["error"]:
        cause, sentence = "error", one_line(row["error"])
    elif row["violation_clause"]:
        # A run that is under way may have the record before the event.
        cause, sentence = row["violation_clause"], readable(story["sentence"]) if story else ""
    else:
        cause, sentence = row["outcome"], _ending(row)
    names = {name: row[name] for name in ("planner", "scenario_id", "half", "outcome")}
    kind, plate = pair_type(row["pair_id"], row["scenario_type"]), (row["sign_code"], row["sign_value"])
    return Failure(**names, type=kind, plate=sign_words(artwork, *plate), cause=cause, sentence=sentence)


def _ending(row: Mapping[str, Any]) -> str:
    fault = "at fault" if row["at_fault"] else "not at fault"
    told = _ENDS[Outcome(row["outcome"])].format(partner=row["collision_partner"], fault=fault)
    return f"At {row['duration_s']:.1f} s {told}, after {row['route_completion']:.0f} % of its way."


def counted(failures: Sequence[Failure], run: StoredRun, planner: str) -> str:
    """How many of a planner's episodes failed, and of what."""
    causes = Counter(failure.cause for failure in failures if failure.planner == planner)
    told = ", ".join(f"{count} {cause}" for cause, count in causes.most_common())
    return f"{planner}: {causes.total()} of {len(run.of(planner))} episodes failed{': ' if told else ''}{told}"


def examples(run: StoredRun) -> Iterator[str]:
    """Lines for each planner with failed episodes: how many and why, then an example of each cause to look at.

    The planners share one screen, so of many planners there are fewer examples.
    """
    found = failures_of(run)
    planners = list(dict.fromkeys(failure.planner for failure in found))
    room = max(1, _LINES // max(1, len(planners)))
    for planner in planners:
        own = [failure for failure in found if failure.planner == planner]
        lines = _wrapped(counted(found, run, planner), (room + 1) // 2)
        causes = [cause for cause, _ in Counter(failure.cause for failure in own).most_common()]
        # A planner's exception comes first, however rare: it is no way of driving.
        for cause in sorted(causes, key="error".__ne__)[:_MOST_CAUSES]:
            first = next(failure for failure in own if failure.cause == cause)
            shown = f"{first.scenario_id}: {first.sentence}" if cause == "error" else shlex.quote(first.name)
            lines += _wrapped(f"  {cause}  {shown}", room - len(lines))
        yield from lines


def _wrapped(text: str, most: int | None = None) -> list[str]:
    """Lines of a terminal, names whole; what is more than `most` is left out."""
    if most == 0:
        return []
    whole = textwrap.TextWrapper(_WIDTH, subsequent_indent="    ", break_on_hyphens=False, break_long_words=False)
    whole.max_lines, whole.placeholder = most, " …"
    return whole.wrap(text)


def listing(run: StoredRun, failures: Sequence[Failure], by: str) -> Iterator[str]:
    """Lines of 80 columns: what came of each planner, then groups, the largest first, with their episodes.

    by: one of GROUPINGS.
    """
    for planner in run.asked:
        yield from _wrapped(counted(failures, run, planner))
    groups: dict[str, list[Failure]] = {}
    for failure in failures:
        groups.setdefault(getattr(failure, GROUPINGS[by]), []).append(failure)
    for name, own in sorted(groups.items(), key=lambda group: -len(group[1])):
        if len(groups) > 1:
            yield from _wrapped(f"{name}: {len(own)} of {len(failures)} failures")
        for failure in own:
            yield f"  {failure.name}"
            facts = dict.fromkeys((f"{failure.half} {failure.plate}", failure.outcome, failure.cause))
            told = f"{', '.join(facts)}: {failure.sentence}"
            yield from textwrap.wrap(told, _WIDTH, initial_indent="    ", subsequent_indent="    ")
