"""Words for captions, pages, recordings and `tsbench scenarios show`: signs, rules, episodes and scenes.

The catalogue names thresholds and options of rules by keys; here they have words and units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from tsbench.episode.trace import Trace
from tsbench.rules.lines import Road
from tsbench.rules.monitors import verdicts_of_other_half
from tsbench.signs.annotations import SignInstance
from tsbench.signs.contrast import SlowZoneParams
from tsbench.signs.countries import Artwork, Country
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, WorldSnapshot

_UNITS = MappingProxyType({"m/s2": "m/s²", "deg": "°"})


def sign_words(artwork: Artwork, code: str, value: float | None) -> str:
    return artwork.code(code) + ("" if value is None else f" ({artwork.value(value)})")


def plate_words(artwork: Artwork, sign: SignInstance) -> str:
    """The sign of a plate, and its ground where that is not the usual one."""
    return sign_words(artwork, sign.code, sign.value) + (" on yellow ground" if sign.temporary else "")


def unit_words(unit: str) -> str:
    """A unit of the catalogue as it is written in print."""
    return _UNITS.get(unit, unit)


def readable(sentence: str) -> str:
    """A sentence of the catalogue with such units, and no sign before a turn by nothing."""
    for unit, word in _UNITS.items():
        gap = r"\s" if word == "°" else ""
        sentence = re.sub(rf"(?<=\d){gap}{re.escape(unit)}\b|(?<=\d ){re.escape(unit)}\b", word, sentence)
    return re.sub(r"[+-]0°", "0°", sentence)


def episode_title(trace: Trace) -> str:
    """Planner and type; of a pair its type and which half, of a square which plates."""
    spec = trace.spec
    return f"{trace.planner}: {spec.pair_type}{', ' if spec.which else ''}{spec.which}"


def episode_subtitle(trace: Trace, artwork: Artwork) -> str:
    spec = trace.spec
    sign = sign_words(artwork, spec.sign_code, spec.sign_value)
    return f"{spec.scenario_id} · sign {sign} · {spec.group} · {spec.split}"


def sign_name(scene: Scene) -> str:
    """The targets of a scene with their names, such as "2.4 Give way"."""
    artwork, catalog = scene.artwork(), scene.catalog
    return " and ".join(
        f"{plate_words(artwork, sign)} {catalog.sign(sign.code).name_en}" for sign in scene.target_signs
    )


def under_other_sign(scene: Scene, other: Scene, snapshots: Sequence[WorldSnapshot]) -> str:
    """What would count against a drive in `scene` with the sign of the other half, in one line.

    Says nothing of how the episode would have ended.
    """
    against = verdicts_of_other_half(other, scene.network, snapshots).against
    said = readable(against[0].sentence) if against else "no violation."
    name = sign_name(other)
    told = "the same sign with others around it" if name == sign_name(scene) else name
    return f"With the other half's plates, {told}, the same drive has: {said}"


def judged_stretch(scene: Scene, at: WorldSnapshot) -> str:
    """Over which metres `needless_slow` took the mean that it judged. at: the last tick of that stretch."""
    zone = next(clause.params for clause in scene.contrast if isinstance(clause.params, SlowZoneParams))
    thresholds = scene.catalog.needless.thresholds
    road = Road(scene.network, zone.zone_edges, beside_widths=thresholds["beside_road_widths"])
    front = road.front(at.ego)
    if front is None or front < zone.start_m:
        return "The mean is that of the drive from its start to where the zone begins."
    over = min(zone.end_m - zone.start_m, thresholds["slow_zone_m"])
    return f"The mean is that of the first {over:.0f} m of the zone."


def scene_facts(scene: Scene, country: Country | None = None) -> dict[str, str]:
    """What stands in a scene, which ways lead through it, and for how long one may drive."""
    artwork = scene.artwork(country)
    return {
        "sign": "; ".join(
            f"{plate_words(artwork, sign)} on edge {sign.edge} at {sign.position_m:.0f} m"
            for sign in scene.target_signs
        ),
        "plates": ", ".join(f"{artwork.code(s.code)} ({s.role}) on {s.edge}" for s in scene.signs),
        "obstacles": ", ".join(f"{o.shape} on {o.lane}" for o in scene.obstacles) or "none",
        "convoy": f"{len(scene.convoy.vehicles)} vehicles" if scene.convoy else "none",
        "navigation": " > ".join(scene.route_hint),
        "obedient way": " > ".join(scene.compliant_hint) or "the same",
        "time": f"{scene.horizon * DT_S:.0f} s",
    }


# By the end of a key, longest first: the unit behind a value.
_UNIT_OF_KEY = (("_mps2", " m/s²"), ("_kmh", " km/h"), ("_mps", " m/s"), ("_deg", "°"), ("_m", " m"), ("_s", " s"))
_RATIO = "_ratio"

THRESHOLDS: Mapping[str, str] = MappingProxyType(
    {
        "against_deg": "largest angle between the ego and the direction of the carriageway that it has entered",
        "beside_road_widths": "distance from the road's middle up to which one drives along it, in road widths",
        "clearance_m": "distance beyond the ego's way at which a pedestrian is clear of it",
        "duration_s": "time after which it counts",
        "engage_distance_m": "distance from which on the rule binds",
        "forced_brake_mps2": "hardest braking that the ego may cause",
        "forced_within_s": "time after the ego's entry in which braking counts",
        "forced_s": "time of hard braking that is force however far away",
        "gap_s": "time that has to be left free",
        "held_s": "duration of a held stop",
        "held_speed_mps": "highest speed of a held stop",
        "held_within_m": "distance to the plate of a held stop",
        "kerb_distance_m": "distance to the kerb from which a pedestrian who comes nearer counts",
        "leader_divisor_mps2": "divisor of the squared speed in the distance to a leader",
        "leader_gap_s": "headway up to which a leader of its own makes a vehicle brake",
        "leader_margin_m": "addition to the distance to a leader",
        "leader_min_m": "least distance up to which a slower leader excuses",
        "least_overlap_m": "least overlap of two ways that counts as a conflict",
        "min_foe_speed_mps": "lowest speed that is assumed of a vehicle with priority",
        "moving_mps": "highest speed at which somebody stands",
        "past_line_m": "distance past the plate from which on it counts",
        "post_clear_s": "time between the ego's leaving and the other's arrival",
        "priority_distance_m": "distance from which on a vehicle with priority counts",
        "settle_distance_m": "way in which to reach the speed",
        "share_ratio": "share of the footprint that counts as inside",
        "share_s": "time after which that share counts",
        "stop_speed_mps": "highest speed of a stop",
        "stop_within_m": "distance to the line within which a stop counts",
        "straight_deg": "largest change of heading that is straight on",
        "sweeps_across_sin": "least sine of the angle to the crossing's line at which the ego drives across it",
        "tolerance_kmh": "tolerance",
        "u_turn_deg": "least change of heading that is a U-turn",
        "walks_along_cos": "least cosine of the angle to the crossing's line at which a pedestrian walks along it",
        "wrong_way_m": "longest way against the circulation",
    }
)
OPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "allowed": "allowed manoeuvres",
        "allowed_sides": "sides on which one may pass",
        "lane": "reserved lane",
        "priority_to": "who has priority",
        "users": "who may drive there",
        "users_direction": "their direction",
    }
)
WORDS: Mapping[str, str] = MappingProxyType(
    {
        "main_arms": "vehicles of the main road",
        "main_arm_on_right": "vehicles of the main road's arm on the right",
        "ring": "vehicles on the ring",
        "bus": "buses",
        "bicycle": "bicycles",
        "same": "the ego's",
        "u_turn": "U-turn",
    }
)


def threshold_value(key: str, value: float) -> str:
    """With the unit that its key names; shares in percent."""
    if key.endswith(_RATIO):
        return f"{100 * value:g} %"
    return f"{value:g}" + next((unit for end, unit in _UNIT_OF_KEY if key.endswith(end)), "")


def in_values(text: str, thresholds: Mapping[str, float]) -> str:
    """A description of the catalogue with values in place of the keys of thresholds."""
    for key, value in thresholds.items():
        text = re.sub(rf"\b{re.escape(key)}\b", threshold_value(key, value), text)
    return text


def option_words(words: tuple[str, ...]) -> str:
    return ", ".join(WORDS.get(word, word) for word in words)
