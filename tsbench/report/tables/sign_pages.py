"""A page for each scenario type: what the law says, the rule with its thresholds, and both halves of one pair.

The sign-blind driver breaks the rule where the expert obeys it: a picture of the moment, and a short film of each. In
the contrast half another drive is right, and the expert's own one from the signed half, repeated there, is wrong.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.dataset.certify.pair import Replay
from tsbench.dataset.scenes.recipe import load_recipe
from tsbench.episode.outcome import Outcome
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, trace_of
from tsbench.planners.base import Control
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.report.drawing.bev import PageSize
from tsbench.report.page.shell import environment
from tsbench.report.video.encode import render_gif
from tsbench.report.video.render import render_png
from tsbench.rules.base import Violation
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.model import ScenarioType, Sign
from tsbench.sim.world import DT_S

EXPERT = "idm-e"
# Where the tempted driver only gets stuck (before an obstacle, say), one who stops for nothing shows the rule broken.
LAWLESS = ("lawless", "tsbench.dataset.certify.lawless:Lawless")
GIF_SIZE = PageSize(400, 360)
TRIES = 20
_BEFORE_S, _AFTER_S = 4.0, 2.0


@dataclass(frozen=True)
class Drives:
    """Of the signed half: broken, obeyed; of the contrast half, if there is one: kept, repeated (obeyed's commands)."""

    broken: Trace
    obeyed: Trace
    kept: Trace | None = None
    repeated: Trace | None = None


class PageMaker:
    """Drives test scenes and writes `<type>.md` with its pictures below `out`."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self._catalog: Catalog = load_catalog()
        self._rows: dict[str, list[ScenarioSpec]] = defaultdict(list)
        self._contrast: dict[str, ScenarioSpec] = {}
        for row in read_table(table_path("test")):
            if row.half == CONTRAST:
                self._contrast[row.pair_id] = row
            else:
                self._rows[row.scenario_type].append(row)
        self._runners: dict[str, EpisodeRunner] = {}

    @property
    def types(self) -> list[str]:
        return [t.id for t in self._catalog.types if t.id in self._rows]

    def write(self, type_id: str) -> Path:
        """One type's page. Raises InputError for a type without test scenarios, or none that shows the rule."""
        kind = self._catalog.type(type_id)
        if type_id not in self._rows:
            raise InputError(f"{type_id}: no test scenarios (tsbench scenarios build makes them)")
        drives = self._drives(type_id)
        broken, obeyed = drives.broken, drives.obeyed
        scene = load_scene(broken.spec)
        folder = self.out / "pictures"
        render_png(broken, scene, folder / f"{type_id}.png")
        films = {"violation": broken, "pass": obeyed, "contrast": drives.kept, "repeated": drives.repeated}
        for name, trace in films.items():
            if trace is not None:
                span = _span(trace, _decisive(broken, trace))
                render_gif(trace, load_scene(trace.spec), folder / f"{type_id}-{name}.gif", GIF_SIZE, span)
        path = self.out / f"{type_id}.md"
        write_atomic(path, self._text(kind, drives).encode())
        return path

    def write_index(self) -> Path:
        lines = ["# Signs and scenario types", "", "| plate | type | group | sign |", "|---|---|---|---|"]
        for kind in self._catalog.types:
            if (self.out / f"{kind.id}.md").is_file():
                signs = [self._catalog.sign(code) for code in kind.codes]
                plates = " ".join(_plate(s, 40) for s in signs)
                names = ", ".join(f"{s.code} {s.name_en}" for s in signs)
                lines.append(f"| {plates} | [`{kind.id}`]({kind.id}.md) | {kind.group} | {names} |")
        path = self.out / "README.md"
        write_atomic(path, ("\n".join(lines) + "\n").encode())
        return path

    def _drives(self, type_id: str) -> Drives:
        """Of one scene: the tempted driver's violation, the expert's obedience, and both in the other half."""
        tempted = load_recipe(type_id, self._catalog).tempted
        # Variants with traffic show more than the nominal one.
        rows = sorted(self._rows[type_id], key=lambda r: (r.variant not in (2, 5), r.variant, r.map_id))
        for name, planner in ((tempted, tempted), LAWLESS):
            for row in rows[:TRIES]:
                broken = self._drive(resolve(planner), name, row)
                if broken.target.violations:
                    obeyed = self._drive(resolve(EXPERT), EXPERT, row)
                    if _passed(obeyed):
                        return self._with_contrast(Drives(broken, obeyed))
        raise InputError(
            f"{type_id}: none of {TRIES} test scenes shows {tempted} breaking the rule and {EXPERT} obeying it"
        )

    def _with_contrast(self, signed: Drives) -> Drives:
        """Raises InputError where the contrast half does not show what its certificate says."""
        row = self._contrast.get(signed.broken.spec.scenario_id)
        if row is None:
            return signed
        kept = self._drive(resolve(EXPERT), EXPERT, row)
        commands = [Control(float(a), float(steer)) for a, steer in signed.obeyed.commands]
        again = LoadedPlanner("again", lambda **_: Replay(commands))
        repeated = self._drive(again, f"{EXPERT}, {row.pair_id}", row)
        if not _passed(kept) or _passed(repeated):
            raise InputError(f"{row.scenario_id}: {EXPERT} does not pass both halves each in its own way")
        return replace(signed, kept=kept, repeated=repeated)

    def _drive(self, planner: LoadedPlanner, name: str, row: ScenarioSpec) -> Trace:
        if name not in self._runners:
            others = list(self._runners.values())
            sim = others[0].simulation if others else None
            self._runners[name] = EpisodeRunner(replace(planner, name=name), simulation=sim)
        return trace_of(self._runners[name].run(row))

    def _text(self, kind: ScenarioType, drives: Drives) -> str:
        signs = [self._catalog.sign(code) for code in kind.codes]
        ends = [self._catalog.sign(code) for code in kind.end_codes]
        other = None if drives.kept is None else self._catalog.sign(drives.kept.spec.sign_code)
        text: str = (
            environment()
            .get_template("sign.md")
            .render(
                kind=kind, signs=signs, ends=ends, rule=signs[0].rule, broken=drives.broken, obeyed=drives.obeyed,
                title=", ".join(dict.fromkeys(s.name_en for s in signs)),
                plates=" ".join(_plate(s, 96) for s in (*signs, *ends)), event=_first_violation(drives.broken),
                kept=drives.kept, repeated=drives.repeated, other=other,
                other_plate="" if other is None else _plate(other, 64),
            )
        )  # fmt: skip
        return text


def _passed(trace: Trace) -> bool:
    return trace.outcome is Outcome.ARRIVED and not trace.events


def _first_violation(trace: Trace) -> Violation:
    return min(trace.target.violations, key=lambda v: v.start_s)


def _plate(sign: Sign, height: int) -> str:
    return f'<img src="../../sign_catalog/plates/{sign.drawing}" height="{height}" alt="{sign.code}">'


def _span(trace: Trace, moment: float) -> tuple[int, int]:
    last = len(trace.snapshots) - 1
    first = max(round((moment - _BEFORE_S) / DT_S), 0)
    return min(first, last), min(round((moment + _AFTER_S) / DT_S), last)


def _decisive(broken: Trace, trace: Trace) -> float:
    """When this ego is nearest to where the tempted one broke the rule, s."""
    event = _first_violation(broken)
    near = min(trace.snapshots, key=lambda s: (s.ego.x - event.x) ** 2 + (s.ego.y - event.y) ** 2)
    return near.time
