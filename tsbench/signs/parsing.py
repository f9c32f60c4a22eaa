"""From a file of `sign_catalog/` to a `RuleSpec` or a `Sign`."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tsbench.signs.model import (
    END_PLACES,
    FAMILIES,
    GROUPS,
    Clause,
    Law,
    MapNeeds,
    OptionSpec,
    Placement,
    PostedValue,
    RuleSpec,
    Sign,
)
from tsbench.signs.reading import Fields, read_yaml

SCHEMA = 1

_SHAPES = {
    "junction": ("T", "X"),
    "roundabout": ("ring",),
    "dual_path": ("T", "X"),
    "corridor": ("straight", "curved"),
}
_SLOTS = ("s_l", "s_r", "l_s", "l_r", "r_s", "r_l")
_SIDES = ("right", "left", "obstacle")
_EDGES = ("approach", "exit", "mid_block")
_FACES = ("ego", "main_arms")
_REFERENCES = ("line", "exit_start", "crossing", "obstacle", "own_line")


def parse_rule(path: Path) -> RuleSpec:
    """The rule of one file as it stands there: what it takes over from another is not yet in it."""
    top = open_file(path)
    name = top.text("rule")
    if name != path.stem:
        top.fail("rule", f"{name!r} stands in the file of {path.stem!r}")
    given = top.optional_fields("thresholds")
    options = top.optional_fields("options")
    vocabulary = {key: _option(options.fields(key)) for key in options.names()}
    clauses = top.optional_fields("clauses")
    rule = RuleSpec(
        name=name,
        extends=top.text("extends") if top.has("extends") else None,
        description=top.text("description").strip(),
        thresholds={key: given.number(key) for key in given.names()},
        options={key: spec.default for key, spec in vocabulary.items() if spec.default is not None},
        vocabulary=vocabulary,
        clauses=tuple(_clause(key, clauses.fields(key)) for key in clauses.names()),
    )
    top.done()
    return rule


def parse_sign(path: Path, rules: Mapping[str, RuleSpec]) -> Sign:
    """The sign of one file, with its rule's thresholds and options filled in.

    Raises:
        InputError: one line: file, key, what is wrong.
    """
    top = open_file(path)
    code = top.text("code")
    if code != path.stem:
        top.fail("code", f"{code!r} stands in the file of {path.stem!r}")
    names, kind, plate = top.fields("names"), top.fields("scenario_type"), top.fields("plate")
    judged = top.fields("rule")
    rule = rules[judged.text("name", rules)]
    is_end = top.has("ends")
    sign = Sign(
        code=code,
        name_ru=names.text("ru"),
        name_en=names.text("en"),
        group=top.text("group", GROUPS),
        type_id=kind.text("id"),
        type_row=kind.integer("row"),
        is_end=is_end,
        ends=top.text("ends") if is_end else None,
        drawing=plate.text("drawing"),
        caption=plate.text("caption"),
        value=_value(top.fields("value")) if top.has("value") else None,
        rule=replace(
            rule,
            thresholds=_thresholds(judged.optional_fields("thresholds"), rule),
            options=_options(judged.optional_fields("options"), rule),
            ended_by=() if is_end else top.texts("ended_by"),
        ),
        placement=_placement(top.fields("placement")),
        law=_law(top.fields("law")),
        maps=_maps(top.fields("maps")),
        context=top.texts("context") if top.has("context") else (),
    )
    for part in (names, kind, plate, judged, top):
        part.done()
    for word in sign.rule.ended_by:
        if word not in END_PLACES and not word[0].isdigit():
            top.fail("ended_by", f"{word!r} is neither a code nor one of {', '.join(END_PLACES)}")
    return sign


def open_file(path: Path) -> Fields:
    """The keys of a catalogue file of this schema; InputError for another."""
    top = read_yaml(path)
    if (schema := top.integer("schema")) != SCHEMA:
        top.fail("schema", f"is {schema}, this version reads {SCHEMA}")
    return top


def _option(given: Fields) -> OptionSpec:
    words = given.texts("words")
    single = given.text("pick", ("one", "some")) == "one"
    default = given.words("default", words) if given.has("default") else None
    if single and default is not None and len(default) != 1:
        given.fail("default", "must be one word")
    given.done()
    return OptionSpec(words, single, default)


def _clause(clause_id: str, given: Fields) -> Clause:
    unit = given.text("unit") if given.has("unit") else ""
    clause = Clause(clause_id, unit, given.text("description").strip(), given.text("sentence").strip())
    given.done()
    try:
        clause.sentence(sign_code="0", time_s=0.0, value=0.0, threshold=0.0, margin=0.0)
    except (KeyError, IndexError, ValueError, AttributeError) as error:
        given.fail("sentence", f"bad template: {error}")
    return clause


def _value(given: Fields) -> PostedValue:
    printed = not given.has("implied")
    allowed = given.numbers("posted") if printed else (given.number("implied"),)
    if not allowed or list(allowed) != sorted(set(allowed)):
        given.fail("posted", "must be different numbers in ascending order")
    value = PostedValue(given.text("unit"), allowed, printed)
    given.done()
    return value


def _thresholds(own: Fields, rule: RuleSpec) -> dict[str, float]:
    for key in own.names():
        if key not in rule.thresholds:
            own.fail(key, f"rule {rule.name} has no such threshold")
    return {key: own.number(key) if own.has(key) else value for key, value in rule.thresholds.items()}


def _options(own: Fields, rule: RuleSpec) -> dict[str, tuple[str, ...]]:
    for key in own.names():
        if key not in rule.vocabulary:
            own.fail(key, f"rule {rule.name} has no such option")
    chosen = {}
    for key, spec in rule.vocabulary.items():
        given = own.has(key) or key not in rule.options
        chosen[key] = own.words(key, spec.words) if given else rule.options[key]
        if spec.single and len(chosen[key]) != 1:
            own.fail(key, "must be one word")
    return chosen


def _placement(given: Fields) -> Placement:
    distance = given.numbers("distance_m")
    if len(distance) != 2 or not 0 <= distance[0] <= distance[1]:
        given.fail("distance_m", "must be [least, greatest], neither negative")
    placement = Placement(
        side=given.text("side", _SIDES),
        edge=given.text("edge", _EDGES),
        faces=given.text("faces", _FACES),
        reference=given.text("reference", _REFERENCES),
        distance_m=(distance[0], distance[1]),
    )
    given.done()
    return placement


def _law(given: Fields) -> Law:
    law = Law(given.text("pdd"), given.text("gost"), given.text("vienna"))
    given.done()
    return law


def _maps(given: Fields) -> MapNeeds:
    family = given.text("family", FAMILIES)
    maps = MapNeeds(
        family=family,
        shapes=given.texts("shapes", _SHAPES[family]),
        slots=given.words("slots", _SLOTS) if family == "dual_path" else (),
        min_lanes=given.optional_integer("min_lanes"),
        max_lanes=given.optional_integer("max_lanes"),
        preferred_min_lanes=given.optional_integer("preferred_min_lanes"),
        min_arms=given.optional_integer("min_arms"),
        one_way=given.flag("one_way"),
        may_span_edges=given.flag("may_span_edges"),
    )
    if not maps.shapes:
        given.fail("shapes", "needs at least one shape")
    given.done()
    return maps
