"""The sign catalogue: `sign_catalog/` as checked, frozen data.

`sign_catalog/rules/<rule>.yaml` holds a rule's clauses and default thresholds, and one sign stands in
`sign_catalog/signs/<code>.yaml`. A file that lies in the folder is in the catalogue; nothing else lists it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, cast

from tsbench.core.errors import InputError
from tsbench.core.paths import data_file, resolved
from tsbench.signs.model import END_PLACES, Clause, Distances, RuleSpec, ScenarioType, Sign, Slot
from tsbench.signs.parsing import parse_combined, parse_distances, parse_rule, parse_sign
from tsbench.signs.rule_kinds import NEEDLESS, OF_NO_PLATE, RULE_KINDS, WRONG_WAY

__all__ = ["Catalog", "Clause", "RuleSpec", "ScenarioType", "Sign", "load_catalog"]

# What cannot change an episode or a record stays out of the contract.
_NOT_IN_CONTRACT = ("name_ru", "name_en", "drawing", "caption", "places", "speeds", "law", "mirrored")


@dataclass(frozen=True)
class Catalog:
    """All signs and rules.

    root: the folder it was read from. signs: by code, in numerical order of the codes. rules: by name, in
    alphabetical order. types: the scenario types in the order of their rows; combined: those with several signs.
    needless, wrong_way: the rules of contrast scenes and of all scenes, which no sign has. distances: bounds of places
    of plates. image: where traffic keeps to the left, the catalogue that it mirrors.
    """

    root: Path
    signs: Mapping[str, Sign]
    rules: Mapping[str, RuleSpec]
    types: tuple[ScenarioType, ...]
    combined: tuple[ScenarioType, ...]
    needless: RuleSpec
    wrong_way: RuleSpec
    distances: Distances
    image: Catalog | None = None

    def sign(self, code: str) -> Sign:
        """The sign of a code; InputError where the catalogue has none."""
        if code not in self.signs:
            raise InputError(f"{self.root}: no sign {code!r} (tsbench signs list names them)")
        return self.signs[code]

    @cached_property
    def code_of_outline(self) -> Mapping[str, str]:
        """What an outline alone says: a code, of the outlines whose signs all have the same rule.

        An octagon is 2.5 from behind, too. Of several signs that ask the same it is the first.
        """
        found: dict[str, list[Sign]] = {}
        for sign in self.signs.values():
            found.setdefault(sign.outline, []).append(sign)
        return {
            outline: alike[0].code
            for outline, alike in found.items()
            if all(sign.rule == alike[0].rule for sign in alike)
        }

    def rule(self, name: str) -> RuleSpec:
        """The rule of a name as bound to no sign; InputError where the catalogue has none."""
        if name not in self.rules:
            raise InputError(f"{self.root}: no rule {name!r}: it has {', '.join(self.rules)}")
        return self.rules[name]

    @property
    def every_type(self) -> tuple[ScenarioType, ...]:
        """Those of one sign, then those with several."""
        return (*self.types, *self.combined)

    def type(self, type_id: str) -> ScenarioType:
        """The scenario type of an id; InputError where the catalogue has none."""
        for kind in self.every_type:
            if kind.id == type_id:
                return kind
        known = ", ".join(kind.id for kind in self.every_type)
        raise InputError(f"{self.root}: no scenario type {type_id!r}: it has {known}")

    def mirrored_type(self, type_id: str) -> str:
        """The id of the type whose signs are the mirror images of this one's: mostly its own."""
        kind = self.type(type_id)
        return kind.id if kind.parts else self.sign(mirrored_code(self.signs, kind.codes[0])).type_id

    def allowed_codes(self, code: str) -> tuple[str, ...]:
        """Codes of all plates that may stand in a scene of a sign: it, what ends it, and its context."""
        sign = self.sign(code)
        ends = (word for word in sign.rule.ended_by if word not in END_PLACES)
        return tuple(dict.fromkeys((code, *ends, *sign.context)))

    def allowed_speeds(self, *, road_class: str, code: str) -> tuple[float, ...] | None:
        """Values that a plate may set on a road of SUMO's class ("highway.primary_link"); None: any."""
        ramp = road_class.removeprefix("highway.")
        road = ramp.removesuffix("_link")
        known, speeds = any(road in sign.speeds for sign in self.signs.values()), self.sign(code).speeds
        return speeds.get(ramp, speeds.get(road, ())) if known else None

    def check_plates(self, codes: Iterable[str], plates: Mapping[str, str], where: str) -> None:
        """InputError where a scene of some signs has a plate of another code than the catalogue says (`allowed_codes`).

        plates: code by id of the plate.
        """
        signs = tuple(codes)
        known = tuple(dict.fromkeys(one for code in signs for one in self.allowed_codes(code)))
        for plate, found in plates.items():
            if found not in known:
                raise InputError(
                    f"{where}: plate {plate!r} is {found}, in a scene of {' and '.join(signs)} may stand "
                    f"{', '.join(known)} (context: in {self.root / 'signs' / signs[0]}.yaml)"
                )

    def contract_entries(self, codes: Iterable[str], contrast: bool = False) -> list[dict[str, Any]]:
        """Everything that can change an episode or a record in scenes of these signs, bound rules included; for JSON.

        By code; then, if there are `contrast` scenes, their rule, with those by which it knows who blocks; last what
        holds in all scenes. Names, captions, drawings, law references and other signs are left out.
        """
        used = {one for code in set(codes) for one in self.allowed_codes(code)}
        signs = [
            {key: value for key, value in asdict(self.sign(code)).items() if key not in _NOT_IN_CONTRACT}
            for code in sorted(used)
        ]
        rules = (self.needless, self.rule("give_way"), self.rule("crosswalk")) if contrast else ()
        return signs + [asdict(rule) for rule in (*rules, self.wrong_way)]


def load_catalog(root: Path | None = None, *, mirrored: bool = False) -> Catalog:
    """Read and check the whole catalogue; the same root is read once per process.

    root: its folder; by default `sign_catalog/` of the data. mirrored: do signs have the rules of their mirror images
    (`mirrored_signs`), as where traffic keeps to the left? Raises InputError, one line: file, key, what is wrong.
    """
    found = resolved(data_file("sign_catalog") if root is None else root)
    return _left_hand(found) if mirrored else _load(found)


@cache
def _left_hand(root: Path) -> Catalog:
    catalog = _load(root)
    signs = mirrored_signs(catalog.signs)
    for code, sign in signs.items():
        # What some plates show is the other way round there: a ring's arrows, the lanes of a road.
        drawing = f"left/{sign.drawing}"
        if (root / "plates" / drawing).is_file():
            signs[code] = replace(sign, drawing=drawing)
    return replace(catalog, signs=signs, image=catalog)


@cache
def _load(root: Path) -> Catalog:
    raw = {rule.name: rule for rule in map(parse_rule, yaml_files(root / "rules"))}
    rules = {name: _inherit(raw, rule, root / "rules" / f"{name}.yaml") for name, rule in raw.items()}
    for name, rule in rules.items():
        _check_kind(root / "rules" / f"{name}.yaml", rule)
    missing = [name for name in OF_NO_PLATE if name not in rules]
    if missing:
        raise InputError(f"{root / 'rules' / missing[0]}.yaml: no such file: scenes are judged by it")
    needless, wrong_way = rules.pop(NEEDLESS.name), rules.pop(WRONG_WAY.name)
    signs = [parse_sign(path, rules) for path in yaml_files(root / "signs")]
    by_code = {sign.code: sign for sign in sorted(signs, key=lambda sign: code_key(sign.code))}
    types: dict[str, ScenarioType] = {}
    for sign in by_code.values():
        try:
            _check_references(root / "plates", sign, by_code)
            _enter_type(types, sign)
        except ValueError as error:
            raise InputError(f"{root / 'signs' / sign.code}.yaml: {error}") from None
    ordered = tuple(sorted(types.values(), key=lambda kind: kind.row))
    return Catalog(
        root,
        by_code,
        rules,
        ordered,
        parse_combined(root / "two_signs.yaml", ordered),
        needless,
        wrong_way,
        parse_distances(root / "places.yaml"),
    )


def code_key(code: str) -> tuple[tuple[int, str], ...]:
    """Sorts codes as numbers: 3.2 before 3.18.1 before 3.24."""
    return tuple((int(part), "") if part.isdigit() else (0, part) for part in code.split("."))


def yaml_files(folder: Path) -> list[Path]:
    """The files of a folder of the catalogue, by name. Raises InputError for an empty folder."""
    paths = sorted(folder.glob("*.yaml"))
    if not paths:
        raise InputError(f"{folder}: no YAML files here")
    return paths


def _inherit(rules: Mapping[str, RuleSpec], rule: RuleSpec, path: Path) -> RuleSpec:
    """The rule with what it takes over; rules are inherited one step deep."""
    if rule.extends is None:
        return rule
    base = rules.get(rule.extends)
    if base is None or base.extends is not None:
        problem = "no such rule" if base is None else "extends another rule itself"
        raise InputError(f"{path}: extends: {rule.extends!r}: {problem}")
    own = {clause.id for clause in rule.clauses}
    return replace(
        rule,
        thresholds={**base.thresholds, **rule.thresholds},
        options={**base.options, **rule.options},
        vocabulary={**base.vocabulary, **rule.vocabulary},
        clauses=(*rule.clauses, *(clause for clause in base.clauses if clause.id not in own)),
    )


def _check_kind(path: Path, rule: RuleSpec) -> None:
    """A rule's file must hold what its kind is declared with: its code reads no more, and no less."""
    kind = OF_NO_PLATE.get(rule.name) or RULE_KINDS.get(rule.name)
    if kind is None:
        raise InputError(f"{path}: rule: {rule.name!r} is not declared in tsbench/signs/rule_kinds.py")
    for part, wanted, given in (
        ("thresholds", kind.thresholds.split(), list(rule.thresholds)),
        ("clauses", kind.clauses.split(), [clause.id for clause in rule.clauses]),
    ):
        for key in sorted({*wanted} ^ {*given}):
            problem = "is missing" if key in wanted else f"no part of the rule {rule.name} reads it"
            raise InputError(f"{path}: {part}: {key}: {problem}")


def _check_references(plates: Path, sign: Sign, signs: Mapping[str, Sign]) -> None:
    """What a sign says about other files must be true."""
    if not (plates / sign.drawing).is_file():
        raise ValueError(f"plate: drawing: no file {plates / sign.drawing}")
    for code in sign.rule.ended_by:
        if code not in END_PLACES and (code not in signs or signs[code].ends != sign.code):
            raise ValueError(f"ended_by: {code!r} is no sign that ends {sign.code}")
    for code in sign.context:
        if code not in signs:
            raise ValueError(f"context: {code!r} is no sign")
    if mirrored_code(signs, sign.mirrored or sign.code) != sign.code:
        raise ValueError(f"mirrored: {sign.mirrored!r} does not name {sign.code} in turn")
    if sign.ends is None:
        return
    if sign.ends not in signs or sign.code not in signs[sign.ends].rule.ended_by:
        raise ValueError(f"ends: {sign.ends!r} is no sign that is ended by {sign.code}")
    if signs[sign.ends].type_id != sign.type_id:
        raise ValueError(f"scenario_type: differs from that of {sign.ends}")


def _enter_type(types: dict[str, ScenarioType], sign: Sign) -> None:
    """Put a sign into its scenario type; signs of one type must agree on row, group and map family."""
    other = next((k for k in types.values() if k.row == sign.type_row and k.id != sign.type_id), None)
    if other is not None:
        raise ValueError(f"scenario_type: row {sign.type_row} is that of {other.id!r}")
    fresh = ScenarioType(sign.type_id, sign.type_row, sign.group, sign.maps.family, (), ())
    known = types.get(sign.type_id, fresh)
    if replace(known, codes=(), end_codes=()) != fresh:
        raise ValueError(f"scenario_type: row, group or family differs within {sign.type_id!r}")
    types[sign.type_id] = (
        replace(known, end_codes=(*known.end_codes, sign.code))
        if sign.is_end
        else replace(known, codes=(*known.codes, sign.code))
    )


_SIDES = {"left": "right", "right": "left", "leftmost": "rightmost", "rightmost": "leftmost"}
_TURNS = str.maketrans("lr", "rl")


def mirrored_code(signs: Mapping[str, Sign], code: str) -> str:
    """The code of a sign's mirror image."""
    return signs[code].mirrored or code


def mirrored_slot(slot: str) -> str:
    """A slot of dual paths, such as `s_l`, in the mirror; "" stays."""
    return slot.translate(_TURNS)


def mirrored_signs(signs: Mapping[str, Sign]) -> dict[str, Sign]:
    """All signs as they bind where traffic keeps to the left, in the same order."""
    return {code: _mirrored(sign, signs[mirrored_code(signs, code)], signs) for code, sign in signs.items()}


def _mirrored(sign: Sign, image: Sign, signs: Mapping[str, Sign]) -> Sign:
    """`sign` with the rule, the place and the maps of its image, mirrored; names, drawing and law stay its own."""
    place, maps = image.placement, image.maps
    return replace(
        sign,
        rule=mirrored_rule(image.rule),
        placement=replace(place, side=_SIDES.get(place.side, place.side)),  # type: ignore[arg-type]
        maps=replace(maps, slots=tuple(cast(Slot, mirrored_slot(slot)) for slot in maps.slots)),
        context=tuple(mirrored_code(signs, code) for code in image.context),
    )


def mirrored_rule(rule: RuleSpec) -> RuleSpec:
    """A rule with left and right swapped in what was chosen for it; thresholds and clauses know no side."""
    options = {name: tuple(_SIDES.get(word, word) for word in words) for name, words in rule.options.items()}
    return replace(rule, options=options)
