"""A page for each scenario type: what the law says, the rule with its thresholds, and both halves of one pair.

The sign-blind driver breaks the rule where the expert obeys it: a picture of the moment, and a short film of each. In
the contrast half another drive is right, and the expert's own one from the signed half, repeated there, is wrong.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image as PilImage

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.outcome import Outcome
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, trace_of
from tsbench.make.certify.evidence import AnswerReplay
from tsbench.make.scenes.recipe import load_recipe
from tsbench.planners.base import Control
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.report.drawing.canvas import Image, PageSize
from tsbench.report.page.page_format import environment
from tsbench.report.scene_pictures import moment, render_gif
from tsbench.report.wording import OPTIONS, THRESHOLDS, in_values, option_words, readable, threshold_value
from tsbench.rules.monitor import Violation
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.signs.model import ScenarioType, Sign
from tsbench.signs.plates import plate_svg
from tsbench.sim.world import DT_S

EXPERT = "idm-e"
# Where the blind baseline only gets stuck (before an obstacle, say), one who stops for nothing shows the rule broken.
LAWLESS = ("lawless", "tsbench.make.certify.lawless:Lawless")
GIF_SIZE = PageSize(480, 420)
TRIES = 20
# A film begins so long before the decision, or as late as lets the ego's way fit into the picture at a legible scale.
_BEFORE_S, _LEAST_BEFORE_S, _AFTER_S = 3.2, 1.6, 1.4
_LEGIBLE_PX_PER_M, _EDGE_M = 6.0, 6.0
_PNG_COLOURS = 256


@dataclass(frozen=True)
class Drives:
    """Of the signed half: broken, obeyed; of the contrast half, if there is one: kept, repeated (obeyed's commands)."""

    broken: Trace
    obeyed: Trace
    kept: Trace | None = None
    repeated: Trace | None = None


class PageMaker:
    """Drives test scenes and writes `<type>.md` with its pictures below `out`."""

    def __init__(self, data: DataSet, out: Path) -> None:
        self.out, self._data, self._catalog = out, data, data.catalog
        self._rows: dict[str, list[ScenarioSpec]] = defaultdict(list)
        self._contrast: dict[str, ScenarioSpec] = {}
        for row in data.table("test"):
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
        scene = load_scene(self._data, broken.spec)
        folder = self.out / "pictures"
        _save_small(folder / f"{type_id}.png", moment(broken, scene, None))
        films = {"violation": broken, "pass": obeyed, "contrast": drives.kept, "repeated": drives.repeated}
        for name, trace in films.items():
            if trace is not None:
                span = _span(trace, _decisive(broken, trace))
                render_gif(trace, load_scene(self._data, trace.spec), folder / f"{type_id}-{name}.gif", GIF_SIZE, span)
        path = self.out / f"{type_id}.md"
        write_atomic(path, self._text(kind, drives).encode())
        return path

    def write_index(self) -> Path:
        lines = ["# Signs and scenario types", "", "| plate | type | group | sign |", "|---|---|---|---|"]
        for kind in self._catalog.types:
            if (self.out / f"{kind.id}.md").is_file():
                signs = [self._catalog.sign(code) for code in kind.codes]
                plates = " ".join(self._plate(s, None, 40) for s in signs)
                names = ", ".join(f"{s.code} {s.name_en}" for s in signs)
                lines.append(f"| {plates} | [`{kind.id}`]({kind.id}.md) | {kind.group} | {names} |")
        path = self.out / "README.md"
        write_atomic(path, ("\n".join(lines) + "\n").encode())
        return path

    def _drives(self, type_id: str) -> Drives:
        """Of one scene: the blind baseline's violation, the expert's obedience, and both in the other half."""
        blind = load_recipe(type_id, self._catalog).blind_baseline
        # Variants with traffic show more than the nominal one.
        rows = sorted(self._rows[type_id], key=lambda r: (r.variant not in (2, 5), r.variant, r.map_id))
        for name, planner in ((blind, blind), LAWLESS):
            for row in rows[:TRIES]:
                broken = self._drive(resolve(planner), name, row)
                if broken.verdicts.violations:
                    obeyed = self._drive(resolve(EXPERT), EXPERT, row)
                    if _passed(obeyed):
                        return self._with_contrast(Drives(broken, obeyed))
        raise InputError(
            f"{type_id}: none of {TRIES} test scenes shows {blind} breaking the rule and {EXPERT} obeying it"
        )

    def _with_contrast(self, signed: Drives) -> Drives:
        """Raises InputError where the contrast half does not show what its certificate says."""
        row = self._contrast.get(signed.broken.spec.scenario_id)
        if row is None:
            return signed
        kept = self._drive(resolve(EXPERT), EXPERT, row)
        commands = [Control(float(a), float(steer)) for a, steer in signed.obeyed.commands]
        again = LoadedPlanner("again", lambda **_: AnswerReplay(commands))
        repeated = self._drive(again, f"{EXPERT} again", row, kept_as=row.pair_id)
        if not _passed(kept) or _passed(repeated):
            raise InputError(f"{row.scenario_id}: {EXPERT} does not pass both halves each in its own way")
        return replace(signed, kept=kept, repeated=repeated)

    def _drive(self, planner: LoadedPlanner, name: str, row: ScenarioSpec, kept_as: str = "") -> Trace:
        """kept_as: under which key the runner is kept for later drives; "" = its name."""
        key = kept_as or name
        if key not in self._runners:
            others = list(self._runners.values())
            sim = others[0].simulation if others else None
            self._runners[key] = EpisodeRunner(replace(planner, name=name), simulation=sim, data=self._data)
        return trace_of(self._runners[key].run(row))

    def _text(self, kind: ScenarioType, drives: Drives) -> str:
        signs = [self._catalog.sign(code) for code in kind.codes]
        ends = [self._catalog.sign(code) for code in kind.end_codes]
        other = None if drives.kept is None else self._catalog.sign(drives.kept.spec.sign_code)
        shown = drives.broken.spec.sign_value
        text: str = (
            environment()
            .get_template("sign.md")
            .render(
                kind=kind, signs=signs, ends=ends, rule=signs[0].rule, broken=drives.broken, obeyed=drives.obeyed,
                title=", ".join(dict.fromkeys(s.name_en for s in signs)), event=_first_violation(drives.broken),
                plates=" ".join(self._plate(s, shown, 96) for s in (*signs, *ends)), kept=drives.kept,
                repeated=drives.repeated, other=other, plate=self._plate, readable=readable, in_values=in_values,
                threshold_value=threshold_value, option_words=option_words, thresholds=THRESHOLDS, options=OPTIONS,
            )
        )  # fmt: skip
        return text

    def _plate(self, sign: Sign, posted: float | None, width: int) -> str:
        """An image of the plate, beside the pages. posted: what it may print; None: the least that it may."""
        number = None
        if sign.value is not None and sign.value.printed:
            number = sign.value.allowed[0] if posted is None else posted
        name = f"pictures/{sign.code}.svg" if number is None else f"pictures/{sign.code}-{number:g}.svg"
        with io_errors_as_input_errors(self.out / name):
            write_atomic(self.out / name, plate_svg(self._data.artwork(), sign.code, number).encode())
        return f'<img src="{name}" width="{width}" alt="{sign.code}">'


def _passed(trace: Trace) -> bool:
    return trace.outcome is Outcome.ARRIVED and not trace.against


def _first_violation(trace: Trace) -> Violation:
    return min(trace.verdicts.violations, key=lambda v: v.start_s)


def _span(trace: Trace, decision: float) -> tuple[int, int]:
    """First and last tick of a film about what happens at `decision` (s)."""
    end = len(trace.snapshots) - 1
    last = min(round((decision + _AFTER_S) / DT_S), end)
    first, latest = (max(round((decision - s) / DT_S), 0) for s in (_BEFORE_S, _LEAST_BEFORE_S))
    track = np.array([(s.ego.x, s.ego.y) for s in trace.snapshots])
    room = np.array((GIF_SIZE.width, GIF_SIZE.view_height)) / _LEGIBLE_PX_PER_M - 2 * _EDGE_M
    while first < latest and (np.ptp(track[first : last + 1], axis=0) > room).any():
        first += 1
    return min(first, end), last


def _save_small(path: Path, picture: Image) -> None:
    """As a PNG of one palette: a third of the bytes of one in full colour. Raises InputError."""
    few = PilImage.fromarray(picture).quantize(_PNG_COLOURS, dither=PilImage.Dither.NONE)
    file = BytesIO()
    few.save(file, format="PNG", optimize=True)
    with io_errors_as_input_errors(path):
        write_atomic(path, file.getvalue())


def _decisive(broken: Trace, trace: Trace) -> float:
    """When a rule is broken, s; where none is, when the ego is nearest to where the blind baseline broke it."""
    if trace.against:
        return min(event.start_s for event in trace.against)
    event = _first_violation(broken)
    near = min(trace.snapshots, key=lambda s: (s.ego.x - event.x) ** 2 + (s.ego.y - event.y) ** 2)
    return near.time
