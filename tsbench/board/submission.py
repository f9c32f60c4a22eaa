"""A submission: one planner's run of a whole split in one JSON file, with a digest for each episode.

`docs/leaderboard.md` says what each field is. A digest is of all that the run's tables say of an episode, so that
another drive of it on alike arithmetic gives the same one.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from tsbench.core.errors import InputError
from tsbench.core.parquet import OSM_LICENCE
from tsbench.core.paths import is_city_name
from tsbench.core.text import fault_in_name, fault_in_texts
from tsbench.core.textfile import read_json, read_yaml
from tsbench.core.typed import typed
from tsbench.episode.outcome import Outcome
from tsbench.episode.perception_level import EXACT, PATH, PerceptionLevel, load_level
from tsbench.metrics.aggregate import summarise
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.metrics.scd import SCD
from tsbench.planners.base import DEVICES
from tsbench.run.log.journal import table_of
from tsbench.run.log.read import EPISODES
from tsbench.run.log.record import Row, head_row
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import SPLITS
from tsbench.scenarios.spec import ScenarioSpec

KIND, SCHEMA_VERSION = "tsbench-submission", 1
# What stands before the fields. The rows are of OpenStreetMap's roads.
_HEAD = {"kind": KIND, "schema": SCHEMA_VERSION, **OSM_LICENCE}
_DIGEST_HEX = 32
_DIGEST = re.compile(rf"[0-9a-f]{{{_DIGEST_HEX}}}")
_Percent = Annotated[float, Meta(ge=0, le=100)]
_Count = Annotated[int, Meta(ge=0)]
# The submitter's own words, in characters.
_LONGEST = {"title": 200, "authors": 1000, "url": 1000, "note": 10_000}
# All other texts: words, hashes, paths.
_LONGEST_LINE = 1000
# Not of what was driven: the name is the planner's in this run, the text of an error names files of a machine.
_UNCOMPARED = ("planner", "error")


@dataclass(frozen=True)
class SubmittedEpisode:
    """The result of one episode. clauses: of the events that count against SCD, sorted; digest: hex."""

    scenario_id: str
    outcome: str
    scd: bool
    clauses: tuple[str, ...]
    digest: str

    @property
    def verdict(self) -> tuple[str, bool, tuple[str, ...]]:
        """What does not depend on the last bits of a machine's arithmetic."""
        return self.outcome, self.scd, self.clauses


@dataclass(frozen=True)
class Figure:
    """One figure of SCD, %, with its 95 % interval. over: all, a group or a type; n: pairs or rows."""

    figure: str
    over: str
    value: _Percent | None
    low: _Percent | None
    high: _Percent | None
    n: _Count


@dataclass(frozen=True)
class Arithmetic:
    """What `tsbench.run.arithmetic.facts` says, as a file may say it."""

    simd: tuple[str, ...]
    blas: str
    libc: str
    versions: dict[str, str | None]
    answers: Answers


@dataclass(frozen=True)
class Answers:
    """Hashes, one for each kind of function."""

    libm: str
    numpy: str
    blas: str


@dataclass(frozen=True)
class Submission:
    """title, authors, url, note: as the submitter gave them. third_party: of people other than tsbench's.

    arithmetic, versions, machine, git: of the run. isolation: what made the planner's sandbox, and its limits; None
    where it shared the referee's process. rescored: episodes that were judged again from their traces.
    episodes: sorted by scenario_id. perception: how plates reached the planner; None: exactly.
    """

    title: Annotated[str, Meta(min_length=1)]
    authors: str
    url: str
    note: str
    third_party: bool
    tsbench: str
    edition: str
    contract: str
    city: str
    split: str
    planner: PlannerInfo
    device: str
    finished: str
    arithmetic: dict[str, Any]
    versions: dict[str, Any]
    machine: dict[str, Any]
    git: dict[str, Any]
    rescored: _Count
    figures: tuple[Figure, ...]
    episodes: tuple[SubmittedEpisode, ...]
    isolation: dict[str, Any] | None = None
    perception: PerceptionLevel | None = None

    @property
    def level(self) -> str:
        """The name of its perception level."""
        return EXACT if self.perception is None else self.perception.name

    @cached_property
    def sha256(self) -> str:
        """SHA-256 (hex) of what it says, in whatever layout its file has: of the file that tsbench writes.

        Raises ValueError for numbers that JSON has none of, such as NaN.
        """
        return hashlib.sha256(self.to_json().encode()).hexdigest()

    def to_json(self) -> str:
        content = {**_HEAD, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of a submission, from its own fields."""
    head = {key: {"const": value} for key, value in _HEAD.items()}
    _, parts = msgspec.json.schema_components([Submission], ref_template="#/$defs/{name}")
    for part in parts.values():
        part["additionalProperties"] = False
    own = parts.pop("Submission")
    named = {"$schema": "https://json-schema.org/draft/2020-12/schema", **own, "title": KIND}
    properties, required = {**head, **own["properties"]}, [*head, *own["required"]]
    return {**named, "properties": properties, "required": required, "$defs": parts}


def read_submission(path: Path) -> Submission:
    """A submission.

    Raises InputError for other files, for what no run can say, and for names that show readers other ones.
    """
    data = read_json(path, "submission")
    if not isinstance(data, dict) or data.pop("kind", None) != KIND:
        raise InputError(f"{path}: no submission (expected `kind: {KIND}`)")
    if (version := data.pop("schema", None)) != SCHEMA_VERSION:
        raise InputError(f"{path}: schema {version!r:.20}, this tsbench reads {SCHEMA_VERSION}")
    if {key: data.pop(key, None) for key in OSM_LICENCE} != OSM_LICENCE:
        raise InputError(f"{path}: malformed submission (licence: expected {OSM_LICENCE['licence']!r})")
    try:
        found = typed(Submission, data)
        if fault := _fault_of_submission(found, data):
            raise ValueError(fault)
        # Refuses numbers that JSON has none of.
        found.sha256  # noqa: B018
    except (ValueError, TypeError) as problem:
        raise InputError(f"{path}: malformed submission ({' '.join(str(problem).split())[:200]})") from None
    ids = [episode.scenario_id for episode in found.episodes]
    if ids != sorted(ids):
        raise InputError(f"{path}: episodes are not sorted by scenario_id")
    return found


def _fault_of_submission(found: Submission, data: Mapping[str, Any]) -> str:
    """What in a submission no run can say, "" where nothing is."""
    # A verification shows a planner the files that it names, and all where it names none.
    shown = found.isolation is None or found.planner.code_sha256 is None or found.planner.files
    return (
        fault_of_words(data)
        or fault_of_lines({key: value for key, value in data.items() if key not in _LONGEST})
        or fault_of_place(found.city, found.split, found.device)
        or fault_of_level(found.perception)
        or fault_of_arithmetic(found.arithmetic)
        or fault_of_planner(found.planner)
        or ("" if shown else "the planner was isolated, and none of its files is named")
        or ("" if found.rescored <= len(found.episodes) else "rescored: is no number of its episodes")
        or fault_of_episodes(found.episodes)
    )


def fault_of_place(city: str, split: str, device: str) -> str:
    """What of where and on what episodes were driven tsbench does not know, "" where it knows all."""
    if not is_city_name(city):
        return f"city {city!r:.60}: a city's name is of a-z, 0-9 and '-'"
    for name, value, known in (("split", split, SPLITS), ("device", device, DEVICES)):
        if value not in known:
            return f"{name} {value!r:.60}: expected {', '.join(known)}"
    return ""


def fault_of_planner(planner: PlannerInfo) -> str:
    """What is wrong with the name of a planner, "" where nothing is."""
    fault = fault_in_name(planner.name)
    return fault and f"the planner's name: {fault}"


def fault_of_arithmetic(told: Any) -> str:
    """Why it is not what `tsbench.run.arithmetic.facts` says, "" where it is."""
    try:
        typed(Arithmetic, told)
    except ValueError as problem:
        return f"arithmetic: {problem}"
    return ""


def fault_of_lines(value: Any) -> str:
    """What is no line of at most so many characters among the texts in a value, keys included; "" where all are."""
    left = [value]
    while left:
        one = left.pop()
        if isinstance(one, str):
            if len(one) > _LONGEST_LINE or not _is_line(one):
                return f"{one!r:.60}: expected one line of at most {_LONGEST_LINE} characters"
        elif isinstance(one, Mapping):
            left += [*one.keys(), *one.values()]
        elif isinstance(one, list | tuple):
            left += one
    return ""


def _is_line(text: str) -> bool:
    return text.splitlines() in ([], [text])


def fault_of_episodes(episodes: Sequence[SubmittedEpisode]) -> str:
    """What in episodes cannot be of a run, "" where nothing is."""
    digests: dict[str, str] = {}
    names: set[str] = set()
    for episode in episodes:
        name = episode.scenario_id
        if name in names:
            return f"{name}: stands twice"
        names.add(name)
        outcome = Outcome(episode.outcome)
        if episode.scd is not (outcome is Outcome.ARRIVED and not episode.clauses):
            told = ", ".join([outcome, *episode.clauses])
            return f"{name}: scd is {str(episode.scd).lower()}, which {told} contradicts"
        if not _DIGEST.fullmatch(episode.digest):
            return f"{name}: digest: expected {_DIGEST_HEX} hexadecimal digits"
        # The name of its scenario is in it.
        if episode.digest in digests:
            return f"{name}: has the digest of {digests[episode.digest]}"
        digests[episode.digest] = name
    return ""


def fault_of_words(words: Mapping[str, Any]) -> str:
    """What is wrong with the submitter's own words, by field; "" where they fit a page."""
    for name, most in _LONGEST.items():
        if len(words[name]) > most or (name != "note" and not _is_line(words[name])):
            return f"{name}: expected {'text' if name == 'note' else 'one line'} of at most {most} characters"
    if fault := fault_in_texts([words[name] for name in _LONGEST]):
        return fault
    # Without a title of its own a submission has the planner's name.
    fault = fault_in_name(words["title"]) if words["title"] else ""
    return fault and f"title: {fault}"


def fault_of_level(level: PerceptionLevel | None) -> str:
    """Why a level is not what its name says to readers, "" where it is.

    The names of tsbench's own levels are for these: levels with other values need other names.
    """
    if level is None:
        return ""
    if fault := fault_in_name(level.name):
        return f"the perception level's name: {fault}"
    name = level.name.strip().casefold()
    if (name != EXACT and name not in read_yaml(PATH, "levels")["levels"]) or load_level(name) == level:
        return ""
    return f"its perception level is called {level.name}, but is not tsbench's level of that name"


def episode_of(row: Row, events: Iterable[Row]) -> SubmittedEpisode:
    """What a submission tells of an episode that stands so in a run's tables."""
    told = sorted((dict(event) for event in events), key=lambda event: event["number"])
    compared = [{key: value for key, value in one.items() if key not in _UNCOMPARED} for one in (dict(row), *told)]
    # NaN and infinities are no JSON; as text they compare like all else.
    text = json.dumps(compared, sort_keys=True, ensure_ascii=False)
    clauses = sorted({event["clause"] for event in told if event["target"]})
    digest = hashlib.sha256(text.encode()).hexdigest()[:_DIGEST_HEX]
    return SubmittedEpisode(row["scenario_id"], row["outcome"], bool(row["scd"]), tuple(clauses), digest)


def figures_of(
    episodes: Sequence[SubmittedEpisode], table: Sequence[ScenarioSpec], planner: PlannerInfo, contract: str
) -> tuple[Figure, ...]:
    """The figures of SCD that follow from the episodes of a whole split.

    Raises InputError where they are not the episodes of its table, each once.
    """
    specs = {spec.scenario_id: spec for spec in table}
    if [episode.scenario_id for episode in episodes] != sorted(specs):
        known = {episode.scenario_id for episode in episodes}
        missing, strange = sorted(specs.keys() - known), sorted(known - specs.keys())
        raise InputError(
            f"the episodes are not those of the split: {len(missing)} missing ({', '.join(missing[:2]) or 'none'}), "
            f"{len(strange)} of no row of it ({', '.join(strange[:2]) or 'none'})"
        )
    rows = []
    for episode in episodes:
        outcome = Outcome(episode.outcome)
        error = "as submitted" if outcome.is_error else None
        row = head_row(specs[episode.scenario_id], planner.name, planner.privileged, outcome, error)
        # Of the other metrics a submission tells nothing, and nothing is made of these.
        others = {m.column: None if error else m.kind() for m in EPISODE_METRICS}
        rows.append({**row, **others, SCD.column: episode.scd})
    told = summarise(table_of(EPISODES, rows), contract_hash=contract, asked={planner.name: len(rows)})
    figures = []
    for name, scores in told.planners[0].scores.items():
        for over, both in {**scores.panels("all"), **scores.types}.items():
            e = both.main
            figures.append(Figure(name, over, e.value, e.low, e.high, e.n))
    return tuple(figures)
