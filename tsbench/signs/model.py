"""What the catalogue says, as frozen data: signs, the rules that judge them, the clauses of a rule."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self, get_args

from msgspec import Meta

from tsbench.core.typed import Count, Number, Text

Group = Literal["priority", "speed", "obstacles", "routing"]
Family = Literal["junction", "roundabout", "dual_path", "corridor"]
Shape = Literal["T", "X", "ring", "straight", "curved"]
Outline = Literal["octagon", "inverted_triangle", "diamond", "triangle", "circle", "rectangle"]
Slot = Literal["s_l", "s_r", "l_s", "l_r", "r_s", "r_l"]
Place = Literal[
    "line", "junction", "priority", "choice", "shown", "open_road", "enterable", "onward", "one_way_across",
    "obstacle", "several_lanes", "by_its_lane", "kerb_lane", "contraflow", "mouth", "unentered", "unused", "entered",
    "begin", "road_speed", "not_before_yield", "crossing", "ring", "alone", "both_ways", "own_direction", "lasting",
]  # fmt: skip
_Positive = Annotated[float, Meta(gt=0.0, lt=1e300)]

GROUPS: tuple[str, ...] = get_args(Group)
# The group of types with several signs.
COMBINED = "two_signs"
OUTLINES: tuple[str, ...] = get_args(Outline)

# Of a value in a sentence, behind the point.
_MOST_DIGITS = 3

# Words that may stand in `ended_by` beside the codes of end plates.
END_PLACES = ("junction", "crossing", "obstacle", "marked_zone")

_SHAPES: Mapping[Family, tuple[Shape, ...]] = {
    "junction": ("T", "X"),
    "roundabout": ("ring",),
    "dual_path": ("T", "X"),
    "corridor": ("straight", "curved"),
}


class _Measured(float):
    """A value that is written with as many digits as tell it from its threshold, up to three."""

    _threshold: float

    def __new__(cls, value: float, threshold: float) -> Self:
        self = super().__new__(cls, value)
        self._threshold = threshold
        return self

    def __format__(self, spec: str) -> str:
        head, dot, digits = spec.removesuffix("f").rpartition(".")
        told = super().__format__(spec)
        for more in range(int(digits) + 1, _MOST_DIGITS + 1) if dot else ():
            if told != format(self._threshold, spec):
                break
            spec = f"{head}.{more}f"
            told = super().__format__(spec)
        return told


@dataclass(frozen=True)
class Clause:
    """One way to break a rule.

    unit: of the event's value, threshold and margin; empty where the clause measures nothing. template: sentence of
    an event, with the fields of `sentence` in braces.
    """

    id: str
    unit: str
    description: str
    template: str

    def __post_init__(self) -> None:
        try:
            self.sentence(sign_code="0", time_s=0.0, value=0.0, threshold=0.0, margin=0.0)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            raise ValueError(f"sentence: bad template: {error}") from None

    def sentence(
        self, *, sign_code: str, time_s: float, value: float, threshold: float, margin: float, other: str | None = None
    ) -> str:
        """An event in words: value, threshold and margin in the clause's unit; other: id of the other road user."""
        return self.template.format(
            clause=self.id,
            sign_code=sign_code,
            time_s=time_s,
            value=_Measured(value, threshold),
            threshold=threshold,
            margin=margin,
            unit=self.unit,
            other="another road user" if other is None else other,
        )


@dataclass(frozen=True)
class OptionSpec:
    """A choice of words that a rule offers to its signs.

    single: exactly one word is chosen, else one or more. default: the choice of a sign that says nothing; None where
    every sign must choose.
    """

    words: tuple[str, ...]
    single: bool
    default: tuple[str, ...] | None


@dataclass(frozen=True)
class RuleSpec:
    """What one monitor watches: all that it needs beside the plate in the scene.

    A `Sign` carries its rule bound to it: with its own thresholds and options. The catalogue's rules are
    unbound: they hold the defaults, and no `ended_by`.

    extends: the rule whose thresholds, options and clauses it takes over. thresholds: by key; the unit is the end of
    the key (`gap_s`, `tolerance_kmh`). options: chosen words; a bound rule has every option of its vocabulary.
    clauses: in the order of the file, inherited ones last. ended_by: codes of end plates and words of END_PLACES;
    empty where nothing in a scene ends the sign.
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

    allowed: the values that scenes may use, ascending. printed: it stands on the plate; where it does not, it is
    implied and there is only one.
    """

    unit: str
    allowed: tuple[float, ...]
    printed: bool


@dataclass(frozen=True)
class Placement:
    """Where a plate may stand.

    side: of the lanes that it faces, or on the obstacle itself. reference: what the distance is counted from: the end
    of the approach lane, the first point of the exit lane, the crossing, the obstacle, or the line that the plate
    makes itself. distance_m: least and greatest, metres: upstream of a line, a crossing or an obstacle, downstream of
    the start of an exit.
    """

    side: Literal["right", "left", "obstacle"]
    edge: Literal["approach", "exit", "mid_block"]
    faces: Literal["ego", "main_arms"]
    reference: Literal["line", "exit_start", "crossing", "obstacle", "own_line"]
    distance_m: tuple[Number, Number]

    def __post_init__(self) -> None:
        if not 0 <= self.distance_m[0] <= self.distance_m[1]:
            raise ValueError("distance_m: must be [least, greatest], neither negative")


@dataclass(frozen=True)
class Distances:
    """Bounds of the places where plates can stand (`sign_catalog/places.yaml`).

    mouth_m: from the junction to a plate at its road's beginning. zone_m: from a begin to its end at least.
    slack_m: of a plate at a line, a crossing or an obstacle. beside_m: along a road, between the plates of its two
    directions at one border or crossing. ring_m: the longest ring. same_arm_deg: two carriageways of one arm point
    within this. swerve_deg: ways straight on over a junction lead no farther aside and back again.
    """

    mouth_m: _Positive
    zone_m: _Positive
    slack_m: _Positive
    beside_m: _Positive
    ring_m: _Positive
    same_arm_deg: _Positive
    swerve_deg: _Positive


@dataclass(frozen=True)
class Law:
    """Where the sign stands in law.

    pdd: paragraphs of the Russian traffic rules (ПДД РФ) and the sign's entry in their appendix 1. gost: Russian
    standards that draw the sign and say where it goes. vienna: article and annex 1 code of the Convention on Road
    Signs and Signals (Vienna, 1968).
    """

    pdd: Text
    gost: Text
    vienna: Text


@dataclass(frozen=True)
class MapNeeds:
    """Maps that can carry the sign.

    shapes: accepted ones, in equal shares. slots: of dual paths only. min_lanes, max_lanes: per direction.
    preferred_min_lanes: taken first where the pool has such maps. min_arms: of a ring. may_span_edges: the zone may
    run over several edges.
    """

    family: Family
    shapes: tuple[Shape, ...]
    slots: tuple[Slot, ...] = ()
    min_lanes: Count | None = None
    max_lanes: Count | None = None
    preferred_min_lanes: Count | None = None
    min_arms: Count | None = None
    one_way: bool = False
    may_span_edges: bool = False

    def __post_init__(self) -> None:
        possible = _SHAPES[self.family]
        for shape in self.shapes:
            if shape not in possible:
                raise ValueError(f"shapes: {shape!r} is none of {', '.join(possible)}")
        if not self.shapes:
            raise ValueError("shapes: needs at least one shape")
        if bool(self.slots) != (self.family == "dual_path"):
            raise ValueError("slots: dual paths have at least one, other families none")


@dataclass(frozen=True)
class Sign:
    """One sign of the catalogue.

    code: GOST R 52290 number, such as "3.24". type_id, type_row: the scenario type it belongs to, and that type's row
    in the table of types. is_end: it only closes the zone of `ends` and is no scenario's target. drawing: file name
    of its SVG under `sign_catalog/plates/`. caption: short English text below the plate in figures. outline: the
    plate's shape, all that is seen of it from behind. value: what it posts, None where it sets no number. rule: the
    one that judges it, bound to the sign (for an end plate: the one that reads it). places: all kinds of places that
    its plate needs (`sign_catalog/places.yaml` says what each is); () is refused nowhere. speeds: by
    class of road ("primary"), the values (km/h) that its plate may set there. context: codes of other
    plates that may stand in its scenes, itself among them where it may stand there again. mirrored: code of the sign
    that this one is in a mirror, "" = it stays what it is.
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
    outline: Outline
    value: PostedValue | None
    rule: RuleSpec
    placement: Placement
    places: tuple[Place, ...]
    speeds: Mapping[str, tuple[float, ...]]
    law: Law
    maps: MapNeeds
    context: tuple[str, ...] = ()
    mirrored: str = ""

    def effective_value(self, posted: float | None) -> float | None:
        """The number that binds drivers: the posted one, or the one that the sign implies.

        Raises ValueError where the sign may not carry the posted value, or needs one and has none.
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
    """The signs that share a row (from 1) of the table of types.

    codes: of its target signs, in numerical order. end_codes: of the plates that close its zone. parts: of a type with
    several signs the types of each, in the order in which the ego meets them; its rows have the group COMBINED.
    """

    id: str
    row: int
    group: str
    family: str
    codes: tuple[str, ...]
    end_codes: tuple[str, ...]
    parts: tuple[str, ...] = ()
