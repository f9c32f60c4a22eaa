"""The kinds of rules that there are, each declared here once, and what stands on their plates.

Everything else attaches to a kind by its name: its texts and numbers (`sign_catalog/rules/<name>.yaml`), its monitor
(`rules/<name>.py`), its expert's constraint (`planners/experts/rules/<name>.py`), its labelled cases
(`tests/cases/<name>/`) and its section of docs/rules.md. A kind that is half there is an error when these are imported.

A plate's params are the parts of the map that it rules, beside its code and its place. They are written as texts
(`PlateParams.texts`) and read back once, when its scene is read (`read_params`). Each field's metadata says what its
names are names of, a number has none; that these are there is checked against the map by `tsbench.sim.scene.Scene`.
What a contrast scene asks beside its plate is written alike (`signs.contrast`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from types import MappingProxyType, ModuleType
from typing import Any, TypeVar

NAMES = "names"
EDGE, LANE = {NAMES: "edge"}, {NAMES: "lane"}
JUNCTION, CROSSING, OBSTACLE = {NAMES: "junction"}, {NAMES: "crossing"}, {NAMES: "obstacle"}


@dataclass(frozen=True)
class PlateParams:
    """Base of all: fields are one name (str), several in order (tuple of str) or a number (float)."""

    def named(self) -> dict[str, tuple[str, ...]]:
        """The names of each field that holds names."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if NAMES in f.metadata}
        return {key: (value,) if isinstance(value, str) else value for key, value in values.items()}

    def texts(self) -> dict[str, str]:
        """As they stand in a scene file: several names with spaces between, none left out."""
        numbers = {f.name: repr(float(getattr(self, f.name))) for f in fields(self) if NAMES not in f.metadata}
        return {**{key: " ".join(names) for key, names in self.named().items() if names}, **numbers}


@dataclass(frozen=True)
class ApproachParams(PlateParams):
    """approach: the edge on which the ego comes to the junction before the plate, or at it."""

    approach: str = field(metadata=EDGE)


@dataclass(frozen=True)
class JunctionParams(ApproachParams):
    """junction: the one at the end of the approach."""

    junction: str = field(metadata=JUNCTION)


@dataclass(frozen=True)
class GiveWayParams(JunctionParams):
    """main_in: the edges into the junction whose vehicles have priority, if any."""

    main_in: tuple[str, ...] = field(default=(), metadata=EDGE)


@dataclass(frozen=True)
class RoundaboutParams(GiveWayParams):
    """ring: all its edges in driving order. `main_in` is the one that leads to the entry."""

    ring: tuple[str, ...] = field(metadata=EDGE, kw_only=True)


@dataclass(frozen=True)
class ZoneParams(PlateParams):
    """zone_edges: in order, the plate's own first; none behind a junction where the sign ends there."""

    zone_edges: tuple[str, ...] = field(metadata=EDGE)


@dataclass(frozen=True)
class ReservedLaneParams(ZoneParams):
    """approach: the edge before the plate. lanes: the reserved ones, of these edges or of the opposite direction."""

    approach: str = field(metadata=EDGE)
    lanes: tuple[str, ...] = field(metadata=LANE)


@dataclass(frozen=True)
class CrosswalkParams(PlateParams):
    """crossing: its id in the network. exit: the edge behind it on the ego's way."""

    crossing: str = field(metadata=CROSSING)
    exit: str = field(metadata=EDGE)


@dataclass(frozen=True)
class ObstacleParams(PlateParams):
    """obstacle: its id in the scene."""

    obstacle: str = field(metadata=OBSTACLE)


Params = TypeVar("Params", bound=PlateParams)


def read_params(kind: type[Params], given: Mapping[str, str]) -> Params:
    """The params of one kind from their texts. Raises ValueError for one that is missing, empty or of no such kind."""
    wanted = {f.name: f for f in fields(kind)}
    for key, param in wanted.items():
        if not given.get(key, "").split() and (key in given or param.default is MISSING):
            raise ValueError(f"param {key!r} is missing")
    strange = sorted(set(given) - set(wanted))
    if strange:
        raise ValueError(f"param {strange[0]!r} is none of {', '.join(wanted)}")
    return kind(**{key: _value(wanted[key], text) for key, text in given.items()})


def _value(param: Field[Any], text: str) -> str | tuple[str, ...] | float:
    names = tuple(text.split())
    if NAMES in param.metadata and param.type != "str":
        return names
    if len(names) != 1:
        raise ValueError(f"param {param.name!r} must be one name, not {text!r}")
    if NAMES in param.metadata:
        return names[0]
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"param {param.name!r}: {text} is not a finite number")
    return number


_UNITS = ("s", "m", "mps", "mps2", "kmh", "deg", "cos", "sin", "widths", "ratio")


@dataclass(frozen=True)
class RuleKind:
    """One kind of rule.

    params: what stands on its plates; None where the plate's own edge and place say all. thresholds: keys of the
    numbers that decide its verdicts, with spaces between; a key ends with its unit. clauses: ids of the ways to break
    it, likewise.
    """

    name: str
    params: type[PlateParams] | None
    thresholds: str
    clauses: str

    def binds(self, params: PlateParams | None) -> bool:
        """Does a plate with these params bind the ego? In a contrast scene the target may bind others, and has none."""
        return params is not None or self.params is None

    def __post_init__(self) -> None:
        for key in self.thresholds.split():
            if key.rpartition("_")[2] not in _UNITS:
                raise ValueError(f"rule {self.name}: threshold {key!r} ends with none of {', '.join(_UNITS)}")


# Of every rule that follows the ego along a road.
_ROAD = "beside_road_widths"
_YIELD = (
    "engage_distance_m priority_distance_m gap_s min_foe_speed_mps post_clear_s least_overlap_m "
    f"forced_brake_mps2 forced_within_s forced_s leader_gap_s {_ROAD}"
)
_YIELD_CLAUSES = "entered_while_blocked encroached forced_braking contact"
_HOLD = "held_speed_mps held_s held_within_m"
_LEADER = "leader_min_m leader_margin_m leader_divisor_mps2"
_WALK = "kerb_distance_m clearance_m moving_mps walks_along_cos sweeps_across_sin"
_TURN = f"straight_deg u_turn_deg {_ROAD}"

_KINDS = (
    RuleKind("give_way", GiveWayParams, _YIELD, _YIELD_CLAUSES),
    RuleKind("stop", GiveWayParams, f"stop_within_m stop_speed_mps {_YIELD}", f"no_full_stop {_YIELD_CLAUSES}"),
    RuleKind("roundabout", RoundaboutParams, f"wrong_way_m {_YIELD}", f"wrong_direction {_YIELD_CLAUSES}"),
    RuleKind("crosswalk", CrosswalkParams, f"engage_distance_m {_WALK} {_ROAD}", "did_not_yield contact"),
    RuleKind("speed", ZoneParams, f"tolerance_kmh {_ROAD}", "over_limit"),
    RuleKind("min_speed", ZoneParams, f"tolerance_kmh settle_distance_m duration_s {_LEADER} {_ROAD}", "under_minimum"),
    RuleKind("detour", ObstacleParams, f"engage_distance_m {_ROAD}", "wrong_side contact off_carriageway"),
    RuleKind("closed_road", ApproachParams, f"engage_distance_m past_line_m {_HOLD} {_ROAD}", "entered_closed_road"),
    RuleKind("manoeuvre", JunctionParams, _TURN, "prohibited_manoeuvre"),
    RuleKind("one_way_exit", JunctionParams, f"against_deg {_TURN}", "wrong_carriageway prohibited_manoeuvre"),
    RuleKind("no_entry", None, f"past_line_m engage_distance_m {_ROAD}", "entered"),
    RuleKind(
        "reserved_lane",
        ReservedLaneParams,
        f"engage_distance_m duration_s share_ratio share_s {_ROAD}",
        "in_reserved_lane contact",
    ),
)
# Of no plate: what a contrast scene asks beside the rule of its plate (`signs.contrast`).
NEEDLESS = RuleKind(
    "needless",
    None,
    "before_line_m behind_m standing_mps standing_s gap_s react_s passage_speed_ratio lowest_speed_ratio "
    "cruise_ratio calm_mps2 lateral_mps2 slow_zone_m slow_speed_ratio least_difference_mps leader_gap_s "
    f"leader_least_m lane_s {_ROAD}",
    "needless_stop needless_yield needless_slow needless_detour",
)
# Of no plate, in every scene: no way leads against the direction of a lane.
WRONG_WAY = RuleKind("wrong_way", None, "longest_m near_obstacle_m", "wrong_way")
OF_NO_PLATE: Mapping[str, RuleKind] = MappingProxyType({kind.name: kind for kind in (NEEDLESS, WRONG_WAY)})
RULE_KINDS: Mapping[str, RuleKind] = MappingProxyType({kind.name: kind for kind in _KINDS})

Part = TypeVar("Part")


def load_rule_classes(
    modules: Mapping[str, ModuleType], base: type[Part], suffix: str = ""
) -> Mapping[str, type[Part]]:
    """For each kind the subclass of `base` in the module of its name and `suffix`; other modules are helpers of these.

    Raises ValueError for a kind without a module, and for a module of a kind that defines none, or several.
    """
    found: dict[str, type[Part]] = {}
    for name in RULE_KINDS:
        file = f"{name}{suffix}"
        if file not in modules:
            places = {module.__name__.rpartition(".")[0] for module in modules.values()}
            raise ValueError(
                f"rule {name!r} is declared in signs/rule_kinds.py, but {', '.join(places)} has no {file}.py"
            )
        module = modules[file]
        own = [
            value
            for value in vars(module).values()
            if isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__
        ]
        if len(own) != 1:
            raise ValueError(f"{module.__file__}: defines {len(own)} {base.__name__} classes, not one")
        found[name] = own[0]
    return MappingProxyType(found)
