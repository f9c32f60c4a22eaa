"""What the catalogue says, as frozen data: signs, the rules that judge them, the clauses of a rule."""

from collections.abc import Mapping
from dataclasses import dataclass

GROUPS = ("priority", "speed", "obstacles", "routing")
FAMILIES = ("junction", "roundabout", "dual_path", "corridor")

# Words that may stand in `ended_by` beside the codes of end plates.
END_PLACES = ("junction", "crossing", "obstacle", "marked_zone")


@dataclass(frozen=True)
class Clause:
    """One way to break a rule.

    Attributes:
        id: such as "over_limit".
        unit: unit of the event's value, threshold and margin; empty where the clause measures nothing.
        description: the formal clause in one sentence.
        template: sentence of an event, with the fields of `sentence` in braces.
    """

    id: str
    unit: str
    description: str
    template: str

    def sentence(
        self,
        *,
        sign_code: str,
        time_s: float,
        value: float,
        threshold: float,
        margin: float,
        other: str | None = None,
    ) -> str:
        """An event in words.

        Args:
            sign_code: code of the sign that was broken.
            time_s: start of the event, s of simulation time.
            value: what was measured, in the clause's unit.
            threshold: what it was measured against, same unit.
            margin: how far the value lies on the wrong side of the threshold, same unit.
            other: id of the other actor, None where there is none.
        """
        return self.template.format(
            clause=self.id,
            sign_code=sign_code,
            time_s=time_s,
            value=value,
            threshold=threshold,
            margin=margin,
            unit=self.unit,
            other="another road user" if other is None else other,
        )


@dataclass(frozen=True)
class OptionSpec:
    """A choice of words that a rule offers to its signs.

    Attributes:
        words: the vocabulary.
        single: exactly one word is chosen; otherwise one or more.
        default: the choice of a sign that says nothing; None where every sign must choose.
    """

    words: tuple[str, ...]
    single: bool
    default: tuple[str, ...] | None


@dataclass(frozen=True)
class RuleSpec:
    """What one monitor watches: all that it needs beside the plate in the scene.

    A `Sign` carries its rule bound to it: with its own thresholds and options. The catalogue's rules are
    unbound: they hold the defaults, and no `ended_by`.

    Attributes:
        name: such as "give_way"; names the monitor.
        extends: the rule whose thresholds, options and clauses it takes over, None where it stands alone.
        description: when the rule binds and what it asks, in a few sentences.
        thresholds: by key; the unit is the end of the key (`gap_s`, `tolerance_kmh`).
        options: chosen words by option; a bound rule has every option of its vocabulary.
        vocabulary: what may be chosen.
        clauses: in the order of the file, inherited ones last.
        ended_by: codes of end plates and words of END_PLACES; empty where nothing in a scene ends the sign.
    """

    name: str
    extends: str | None
    description: str
    thresholds: Mapping[str, float]
    options: Mapping[str, tuple[str, ...]]
    vocabulary: Mapping[str, OptionSpec]
    clauses: tuple[Clause, ...]
    ended_by: tuple[str, ...] = ()

    @property
    def ends_at_junction(self) -> bool:
        """Whether the sign's zone is over at the next junction."""
        return "junction" in self.ended_by

    def option(self, name: str) -> str:
        """The one word chosen for an option; ValueError where there are several."""
        words = self.options[name]
        if len(words) != 1:
            raise ValueError(f"rule {self.name}: option {name} has {len(words)} words, not one")
        return words[0]

    def clause(self, clause_id: str) -> Clause:
        """The clause of that id; KeyError where the rule has none."""
        for clause in self.clauses:
            if clause.id == clause_id:
                return clause
        raise KeyError(f"rule {self.name} has no clause {clause_id!r}")


@dataclass(frozen=True)
class PostedValue:
    """The number that a sign sets.

    Attributes:
        unit: such as "km/h".
        allowed: the values that scenes may use, ascending.
        printed: the number stands on the plate; where it does not, it is implied and there is only one.
    """

    unit: str
    allowed: tuple[float, ...]
    printed: bool


@dataclass(frozen=True)
class Placement:
    """Where a plate may stand.

    Attributes:
        side: "right" or "left" of the lanes it faces, or "obstacle": on the obstacle itself.
        edge: "approach" to the junction, "exit" from it, or "mid_block".
        faces: whose traffic it faces: "ego" or "main_arms".
        reference: what the distance is counted from: "line" (end of the approach lane), "exit_start" (first
            point of the exit lane), "crossing", "obstacle", or "own_line" (the plate makes the line itself).
        distance_m: least and greatest distance from the reference, metres: upstream of a line, a crossing or
            an obstacle, downstream of the start of an exit.
    """

    side: str
    edge: str
    faces: str
    reference: str
    distance_m: tuple[float, float]


@dataclass(frozen=True)
class Law:
    """Where the sign stands in law.

    Attributes:
        pdd: paragraphs of the Russian traffic rules (ПДД РФ) and the sign's entry in their appendix 1.
        gost: Russian standards that draw the sign and say where it goes.
        vienna: article and annex 1 code of the Convention on Road Signs and Signals (Vienna, 1968).
    """

    pdd: str
    gost: str
    vienna: str


@dataclass(frozen=True)
class MapNeeds:
    """Maps that can carry the sign.

    Attributes:
        family: one of FAMILIES.
        shapes: accepted shapes, in equal shares ("T", "X", "ring", "straight", "curved").
        slots: dual-path slots such as "l_s"; empty for other families.
        min_lanes, max_lanes: lanes per direction, None where there is no bound.
        preferred_min_lanes: taken first where the pool has such maps.
        min_arms: arms of a ring.
        one_way: the road must be one-way.
        may_span_edges: the zone may run over several edges.
    """

    family: str
    shapes: tuple[str, ...]
    slots: tuple[str, ...] = ()
    min_lanes: int | None = None
    max_lanes: int | None = None
    preferred_min_lanes: int | None = None
    min_arms: int | None = None
    one_way: bool = False
    may_span_edges: bool = False


@dataclass(frozen=True)
class Sign:
    """One sign of the catalogue.

    Attributes:
        code: GOST R 52290 number, such as "3.24".
        name_ru, name_en: official Russian name and its English rendering.
        group: one of GROUPS.
        type_id, type_row: the scenario type it belongs to, and that type's row in the table of types.
        is_end: it only closes the zone of `ends` and is no scenario's target.
        ends: code of the sign whose zone it closes, None for others.
        drawing: file name of its SVG under `sign_catalog/plates/`.
        caption: short English text below the plate in figures.
        value: what it posts, None where it sets no number.
        rule: the rule that judges it, bound to the sign (for an end plate: the rule that reads it).
        placement, law, maps: see the classes.
        context: codes of other plates that may stand in its scenes, itself among them where it may stand there again.
    """

    code: str
    name_ru: str
    name_en: str
    group: str
    type_id: str
    type_row: int
    is_end: bool
    ends: str | None
    drawing: str
    caption: str
    value: PostedValue | None
    rule: RuleSpec
    placement: Placement
    law: Law
    maps: MapNeeds
    context: tuple[str, ...] = ()

    def effective_value(self, posted: float | None) -> float | None:
        """The number that binds drivers: the posted one, or the one that the sign implies.

        Raises:
            ValueError: the posted value is not one that the sign may carry, or it needs one and has none.
        """
        if self.value is None:
            if posted is not None:
                raise ValueError(f"sign {self.code} carries no value, {posted:g} was given")
            return None
        if posted is None and not self.value.printed:
            return self.value.allowed[0]
        if posted not in self.value.allowed:
            allowed = ", ".join(f"{number:g}" for number in self.value.allowed)
            raise ValueError(f"sign {self.code} carries {allowed} {self.value.unit}, not {posted}")
        return posted


@dataclass(frozen=True)
class ScenarioType:
    """One scenario type: the signs that share a row of the table of types.

    Attributes:
        id: such as "speed_limit".
        row: number in the table of types, from 1.
        group: one of GROUPS.
        family: one of FAMILIES.
        codes: codes of its target signs, in numerical order.
        end_codes: codes of the plates that close its zone.
    """

    id: str
    row: int
    group: str
    family: str
    codes: tuple[str, ...]
    end_codes: tuple[str, ...]
