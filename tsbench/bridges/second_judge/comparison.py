"""Two judges over one run: agreement, and what each disagreement comes from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.bridges.second_judge.commonroad_monitor import SPEED, STOP, ExportedDrive, Reading
from tsbench.report.analyses.analysis import markdown_row
from tsbench.report.episode_files import Selection, export_kind, select_episodes
from tsbench.run.log.read import read_run
from tsbench.run.run_traces import Traces

# By our clause: the types whose scenes ask it, and how the other judge is asked.
RULES: Mapping[str, tuple[str, tuple[str, ...], Mapping[str, Reading]]] = {
    "over_limit": ("R_G3, speed limit", ("speed_limit", "zone_speed_limit", "residential_zone"), SPEED),
    "no_full_stop": ("R_IN1, stop", ("stop",), STOP),
}
WHY = {
    "front": "the limit held for a part of the ego, not for its front: the published rule takes the footprint",
    "tolerance": "up to 1 km/h over the limit: the published rule has no tolerance",
    "ours": "both the tolerance and the footprint",
    "stop": "a full stop, but shorter than 3 s, or farther than 1 m from the line, as the published rule asks",
    "": "not explained",
}


@dataclass(frozen=True)
class Case:
    """One episode under one rule: did each judge see it broken? theirs: by reading."""

    planner: str
    scenario_id: str
    clause: str
    ours: bool
    theirs: Mapping[str, bool]

    def agrees(self, reading: str) -> bool:
        return self.theirs[reading] == self.ours

    @property
    def why(self) -> str:
        """Key of WHY: the first reading that agrees where the published one does not; "" for none."""
        found = next((name for name in self.theirs if self.agrees(name)), "")
        return "stop" if found == "ours" and self.clause == "no_full_stop" else found


def cases(run: Path, folder: Path, progress: Callable[[int, int], None]) -> Iterator[Case]:
    """Each traced episode of the types that both judge. folder: for exported files. Raises InputError."""
    types = tuple(kind for _, kinds, _ in RULES.values() for kind in kinds)
    kind, traces = export_kind("commonroad"), Traces(read_run(run))
    chosen = select_episodes(traces.run, Selection(types=types))
    for number, key in enumerate(chosen):
        progress(number, len(chosen))
        file = kind.path(folder, key)
        trace = kind.make(traces, traces.run.row("/".join(key)), file)
        drive = ExportedDrive(file)
        for clause, (_, kinds, readings) in RULES.items():
            if trace.spec.scenario_type in kinds:
                ours = any(event.clause == clause for event in trace.against)
                theirs = {name: drive.least(reading) < 0.0 for name, reading in readings.items()}
                yield Case(trace.planner, trace.spec.scenario_id, clause, ours, theirs)


def table(found: Sequence[Case]) -> str:
    """Markdown: by rule the episodes, who saw what, agreement as published and with our thresholds."""
    head = (
        "rule",
        "episodes",
        "both: broken",
        "both: kept",
        "only theirs",
        "only ours",
        "agreement",
        "with our thresholds",
    )
    lines = [markdown_row(head), markdown_row(["---"] * len(head))]
    for clause, (title, _, _) in RULES.items():
        of = [case for case in found if case.clause == clause]
        if not of:
            continue
        tally = Counter((case.ours, case.theirs["published"]) for case in of)
        counts = [tally[key] for key in ((True, True), (False, False), (False, True), (True, False))]
        shares = [sum(case.agrees(name) for case in of) / len(of) for name in ("published", "ours")]
        lines.append(markdown_row([title, str(len(of)), *map(str, counts), *(f"{share:.1%}" for share in shares)]))
    return "\n".join(lines) + "\n"


def reasons(found: Sequence[Case]) -> str:
    """Markdown: every reason for disagreement with its episodes, and those that none explains by name."""
    apart = [case for case in found if not case.agrees("published")]
    head = ("rule", "disagreement", "episodes")
    lines = [markdown_row(head), markdown_row(["---"] * len(head))]
    tally = Counter((case.clause, case.why) for case in apart)
    for (clause, why), count in sorted(tally.items()):
        lines.append(markdown_row([RULES[clause][0], WHY[why], str(count)]))
    lines += [f"\nNot explained: {c.planner}/{c.scenario_id} ({c.clause})" for c in apart if not c.why]
    return "\n".join(lines) + "\n"


def rows(found: Sequence[Case]) -> list[dict[str, Any]]:
    """One plain row for each case, for a CSV."""
    return [
        {
            "planner": case.planner,
            "scenario_id": case.scenario_id,
            "clause": case.clause,
            "ours": case.ours,
            **{f"theirs_{name}": case.theirs.get(name) for name in SPEED},
            "why": "" if case.why == "published" else WHY[case.why],
        }
        for case in found
    ]
