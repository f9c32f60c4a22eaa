"""The files of `sign_catalog/` as they are written, and what they mean: a `RuleSpec`, a `Sign`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from tsbench.core.typed import Count, Number, Text, read_sheet
from tsbench.signs.model import (
    COMBINED,
    END_PLACES,
    Clause,
    Distances,
    Group,
    Law,
    MapNeeds,
    OptionSpec,
    Outline,
    Place,
    Placement,
    PostedValue,
    RuleSpec,
    ScenarioType,
    Sign,
)

# One word, or a list of them.
_Words = Text | tuple[Text, ...]


@dataclass(frozen=True)
class _Option:
    words: tuple[Text, ...]
    pick: Literal["one", "some"]
    default: _Words = ()


@dataclass(frozen=True)
class _Clause:
    description: Text
    sentence: Text
    unit: Text = ""


@dataclass(frozen=True)
class _RuleFile:
    rule: Text
    description: Text
    extends: Text | None = None
    thresholds: Mapping[str, Number] = field(default_factory=dict)
    options: Mapping[str, _Option] = field(default_factory=dict)
    clauses: Mapping[str, _Clause] = field(default_factory=dict)


@dataclass(frozen=True)
class _Names:
    ru: Text
    en: Text


@dataclass(frozen=True)
class _Type:
    id: Text
    row: Count


@dataclass(frozen=True)
class _Plate:
    drawing: Text
    caption: Text
    outline: Outline


@dataclass(frozen=True)
class _Value:
    unit: Text
    posted: tuple[Number, ...] = ()
    implied: Number | None = None


@dataclass(frozen=True)
class _Rule:
    name: Text
    thresholds: Mapping[str, Number] = field(default_factory=dict)
    options: Mapping[str, _Words] = field(default_factory=dict)


@dataclass(frozen=True)
class _SignFile:
    code: Text
    names: _Names
    group: Group
    scenario_type: _Type
    plate: _Plate
    rule: _Rule
    placement: Placement
    places: tuple[Place, ...]
    law: Law
    maps: MapNeeds
    value: _Value | None = None
    speeds: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    ended_by: tuple[Text, ...] | None = None
    ends: Text | None = None
    context: tuple[Text, ...] = ()
    mirrored: Text = ""


def parse_rule(path: Path) -> RuleSpec:
    """The rule of one file as it stands there: what it takes over from another is not yet in it."""
    return read_sheet(_RuleFile, path, "rule", _rule)


@dataclass(frozen=True)
class _PlacesFile:
    table: Text
    distances: Distances


@dataclass(frozen=True, kw_only=True)
class _CombinedFile:
    table: str
    types: dict[str, Annotated[tuple[str, ...], Meta(min_length=1, max_length=2)]]


def parse_distances(path: Path) -> Distances:
    """The bounds of places."""
    return read_sheet(_PlacesFile, path, "table", lambda file: file.distances)


def parse_combined(path: Path, types: Sequence[ScenarioType]) -> tuple[ScenarioType, ...]:
    """The types with several signs, behind the others."""
    return read_sheet(_CombinedFile, path, "table", lambda file: tuple(_combined(file, types)))


def _combined(file: _CombinedFile, types: Sequence[ScenarioType]) -> Iterator[ScenarioType]:
    known = {kind.id: kind for kind in types}
    for number, (name, given) in enumerate(file.types.items(), len(types) + 1):
        parts = given if len(given) > 1 else given * 2
        for part in parts:
            if part not in known:
                raise ValueError(f"types: {name}: {part!r} is no type of one sign")
        last = known[parts[-1]]
        codes = tuple(code for part in parts for code in known[part].codes)
        yield ScenarioType(name, number, COMBINED, last.family, codes, (), parts)


def parse_sign(path: Path, rules: Mapping[str, RuleSpec]) -> Sign:
    """The sign of one file, with its rule's thresholds and options filled in."""
    return read_sheet(_SignFile, path, "code", lambda file: _sign(file, rules))


def _rule(file: _RuleFile) -> RuleSpec:
    vocabulary = {}
    for key, option in file.options.items():
        default = _words(option.default)
        vocabulary[key] = OptionSpec(option.words, option.pick == "one", default or None)
        _check_choice(f"options: {key}: default", vocabulary[key], default or option.words[:1])
    clauses = []
    for key, clause in file.clauses.items():
        try:
            clauses.append(Clause(key, clause.unit, clause.description, clause.sentence))
        except ValueError as error:
            raise ValueError(f"clauses: {key}: {error}") from None
    return RuleSpec(
        name=file.rule,
        extends=file.extends,
        description=file.description,
        thresholds=file.thresholds,
        options={key: spec.default for key, spec in vocabulary.items() if spec.default is not None},
        vocabulary=vocabulary,
        clauses=tuple(clauses),
    )


def _sign(file: _SignFile, rules: Mapping[str, RuleSpec]) -> Sign:
    if file.rule.name not in rules:
        raise ValueError(f"rule: name: {file.rule.name!r} is none of {', '.join(rules)}")
    if (file.ends is None) == (file.ended_by is None):
        raise ValueError("ended_by: is missing" if file.ends is None else "ended_by: nothing ends an end plate")
    ended_by = file.ended_by or ()
    for word in ended_by:
        if word not in END_PLACES and not word[0].isdigit():
            raise ValueError(f"ended_by: {word!r} is neither a code nor one of {', '.join(END_PLACES)}")
    rule = _bound(file.rule, rules[file.rule.name])
    for place, there, lacks in (
        ("road_speed", file.value, "the sign sets no value"),
        ("begin", file.ends, "the sign ends no other"),
        ("choice", "allowed" in rule.options, "its rule permits no turns"),
    ):
        if place in file.places and not there:
            raise ValueError(f"places: {place}: {lacks}")
    value = None if file.value is None else _value(file.value)
    if bool(file.speeds) != ("road_speed" in file.places and file.ends is None):
        raise ValueError("speeds: go with the place road_speed, and stand in the file of the sign that begins")
    for road, values in file.speeds.items():
        if strange := [v for v in values if value is None or v not in value.allowed]:
            raise ValueError(f"speeds: {road}: the sign sets no {strange[0]:g}")
    return Sign(
        code=file.code,
        name_ru=file.names.ru,
        name_en=file.names.en,
        group=file.group,
        type_id=file.scenario_type.id,
        type_row=file.scenario_type.row,
        is_end=file.ends is not None,
        ends=file.ends,
        drawing=file.plate.drawing,
        caption=file.plate.caption,
        outline=file.plate.outline,
        value=value,
        rule=replace(rule, ended_by=ended_by),
        placement=file.placement,
        places=file.places,
        speeds=file.speeds,
        law=file.law,
        maps=file.maps,
        context=file.context,
        mirrored=file.mirrored,
    )


def _bound(own: _Rule, rule: RuleSpec) -> RuleSpec:
    """The rule with a sign's own thresholds and options."""
    for what, given, known in (
        ("threshold", own.thresholds, rule.thresholds),
        ("option", own.options, rule.vocabulary),
    ):
        for key in given:
            if key not in known:
                raise ValueError(f"rule: {what}s: {key}: rule {rule.name} has no such {what}")
    options = {}
    for key, spec in rule.vocabulary.items():
        if key not in own.options and key not in rule.options:
            raise ValueError(f"rule: options: {key}: is missing")
        options[key] = _words(own.options[key]) if key in own.options else rule.options[key]
        _check_choice(f"rule: options: {key}", spec, options[key])
    return replace(rule, thresholds={**rule.thresholds, **own.thresholds}, options=options)


def _check_choice(where: str, spec: OptionSpec, chosen: tuple[str, ...]) -> None:
    strange = [word for word in chosen if word not in spec.words]
    if strange:
        raise ValueError(f"{where}: {strange[0]!r} is none of {', '.join(spec.words)}")
    if spec.single and len(chosen) != 1:
        raise ValueError(f"{where}: must be one word")
    if not chosen:
        raise ValueError(f"{where}: needs at least one word")


def _words(given: _Words) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else given


def _value(given: _Value) -> PostedValue:
    allowed = given.posted if given.implied is None else (given.implied,)
    if not allowed or list(allowed) != sorted(set(allowed)):
        raise ValueError("value: posted: must be different numbers in ascending order")
    return PostedValue(given.unit, allowed, given.implied is None)
