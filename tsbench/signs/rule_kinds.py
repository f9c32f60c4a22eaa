"""The kinds of rules that there are, each declared here once.

Everything else attaches to a kind by its name: its texts and numbers (`sign_catalog/rules/<name>.yaml`), its monitor
(`rules.registry`), its expert's constraint (`planners.expert`), how it is taught (`learn.finetune_targets`), its
labelled cases (`tests/cases/<name>/`) and its section of docs/rules.md. Tables in code go through `for_every_kind`, so
that a kind that is half there is an error when they are imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

from tsbench.signs.plate_params import (
    ApproachParams,
    CrosswalkParams,
    GiveWayParams,
    JunctionParams,
    ObstacleParams,
    PlateParams,
    ReservedLaneParams,
    RoundaboutParams,
    ZoneParams,
)

_UNITS = ("s", "m", "mps", "mps2", "kmh", "deg", "cos", "sin", "widths")


@dataclass(frozen=True)
class RuleKind:
    """One kind of rule.

    Attributes:
        name: such as "give_way".
        params: what stands on its plates; None where the plate's own edge and place say all.
        thresholds: keys of the numbers that decide its verdicts, with spaces between; a key ends with its unit.
        clauses: ids of the ways to break it, likewise.
    """

    name: str
    params: type[PlateParams] | None
    thresholds: str
    clauses: str

    def __post_init__(self) -> None:
        for key in self.thresholds.split():
            if key.rpartition("_")[2] not in _UNITS:
                raise ValueError(f"rule {self.name}: threshold {key!r} ends with none of {', '.join(_UNITS)}")


# Of every rule that follows the ego along a road.
_ROAD = "beside_road_widths"
_YIELD = f"engage_distance_m priority_distance_m gap_s min_foe_speed_mps post_clear_s least_overlap_m {_ROAD}"
_YIELD_CLAUSES = "entered_while_blocked encroached contact"
_HOLD = "held_speed_mps held_s held_within_m"
_LEADER = "leader_min_m leader_margin_m leader_divisor_mps2"
_WALK = "kerb_distance_m clearance_m moving_mps walks_along_cos sweeps_across_sin"
_TURN = f"straight_deg u_turn_deg {_ROAD}"

_KINDS = (
    RuleKind("give_way", GiveWayParams, _YIELD, _YIELD_CLAUSES),
    RuleKind(
        "stop", GiveWayParams, f"stop_within_m stop_speed_mps {_YIELD}", f"no_full_stop {_YIELD_CLAUSES}"
    ),
    RuleKind("roundabout", RoundaboutParams, f"wrong_way_m {_YIELD}", f"wrong_direction {_YIELD_CLAUSES}"),
    RuleKind("crosswalk", CrosswalkParams, f"engage_distance_m {_WALK} {_ROAD}", "did_not_yield contact"),
    RuleKind("speed", ZoneParams, f"tolerance_kmh {_ROAD}", "over_limit"),
    RuleKind(
        "min_speed",
        ZoneParams,
        f"tolerance_kmh settle_distance_m duration_s {_LEADER} {_ROAD}",
        "under_minimum",
    ),
    RuleKind("detour", ObstacleParams, f"engage_distance_m {_ROAD}", "wrong_side contact off_carriageway"),
    RuleKind(
        "closed_road", ApproachParams, f"engage_distance_m past_line_m {_HOLD} {_ROAD}", "entered_closed_road"
    ),
    RuleKind("manoeuvre", JunctionParams, _TURN, "prohibited_manoeuvre"),
    RuleKind(
        "one_way_exit", JunctionParams, f"against_deg {_TURN}", "wrong_carriageway prohibited_manoeuvre"
    ),
    RuleKind("no_entry", None, f"past_line_m engage_distance_m {_ROAD}", "entered"),
    RuleKind(
        "reserved_lane",
        ReservedLaneParams,
        f"engage_distance_m duration_s {_ROAD}",
        "in_reserved_lane contact",
    ),
)
RULE_KINDS: Mapping[str, RuleKind] = MappingProxyType({kind.name: kind for kind in _KINDS})

Part = TypeVar("Part")


def for_every_kind(what: str, table: Mapping[str, Part]) -> Mapping[str, Part]:
    """A table by kind of rule, read-only. Raises ValueError where a declared kind has no entry or an entry no kind."""
    missing = [name for name in RULE_KINDS if name not in table]
    strange = [name for name in table if name not in RULE_KINDS]
    if missing:
        raise ValueError(f"rule {missing[0]!r} is declared in signs/rule_kinds.py, but has no {what}")
    if strange:
        raise ValueError(f"a {what} for rule {strange[0]!r}, which is not declared in signs/rule_kinds.py")
    return MappingProxyType(dict(table))
