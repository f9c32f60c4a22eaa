"""Can a plate stand where it stands? One check for each kind of place of `sign_catalog/places.yaml`. Units: m, km/h.

Where plates are placed: `tsbench.make.placements`. Which kinds of places a sign needs: `places` of its file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import get_args

from tsbench.geometry.elementary import STRAIGHT, TURNS, U_TURN
from tsbench.make.scenes.plate_surroundings import CLOSED, ONE_WAY, PlacedPlates, PlateHere
from tsbench.roads.network import RoadNetwork
from tsbench.roads.reserved_lanes import is_reserved
from tsbench.signs.annotations import TARGET, SignInstance
from tsbench.signs.model import Place

# How far beside its road's edge a plate can stand.
PLATE_SIDE_M = (0.3, 3.0)
# Of the plates of both directions at one place: cosine of the least angle between them, and the widest road.
_AGAINST, _ACROSS_M = -0.8, 60.0
_FORBIDS_TURNS, _ORDERS_TURNS = "3.18.", "4.1."
_NEVER_TOGETHER = ({"min_speed", "reserved_lane"}, {"manoeuvre", "one_way_exit", "roundabout"})
# Places of a road that leads to a junction.
_BEFORE_JUNCTIONS = frozenset(
    ["line", "priority", "choice", "shown", "enterable", "onward", "one_way_across", "ring", "lasting"]
)
_MINOR, _MAJOR = ("2.4", "2.5"), ("2.1", "2.3.1", "2.3.2", "2.3.3")


def refused(scene: PlacedPlates, plate: SignInstance) -> tuple[tuple[Place, str], ...]:
    """Each kind of place that a plate of a scene needs and does not have, with the reason; () where it can stand."""
    here = PlateHere(scene, plate)
    asked = here.sign.places if here.ahead.junction else (p for p in here.sign.places if p not in _BEFORE_JUNCTIONS)
    answers = ((place, _CHECKS[place](here)) for place in asked)
    return tuple((place, why) for place, why in answers if why)


def _line(here: PlateHere) -> str:
    if here.ahead.distance > here.farthest:
        return f"stands {here.ahead.distance:.0f} m before the line, at most {here.farthest:.0f} m"
    return ""


def _junction(here: PlateHere) -> str:
    if not here.ahead.junction:
        return "its road leads to no junction: it faces traffic that leaves"
    swerve = here.scene.roads.swerve(here.ahead.junction)
    most = here.scene.catalog.distances.swerve_deg
    return f"straight on swerves by {swerve:.0f} degrees at its junction" if swerve > most else ""


def _priority(here: PlateHere) -> str:
    approach, minor = here.ahead.edges[-1], here.plate.code in _MINOR
    owed = here.scene.roads.gives_way_to(approach)
    if minor and not any(owed):
        return "traffic there has right of way"
    # Where a main road bends, all ways of one of its arms give way to the other.
    if not minor and owed and all(owed) and len(set().union(*owed)) > 1:
        return "traffic there gives way"
    others = {
        ahead.edges[-1]: other.code in _MINOR
        for other in here.scene.plates
        if other.code in (*_MINOR, *_MAJOR) and other.id != here.plate.id
        for ahead in (here.scene.roads.approach(edge=other.edge, s=other.position_m),)
        if ahead.junction == here.ahead.junction
    }
    if others.get(approach, minor) != minor:
        return "another plate on the approach says the opposite"
    if not minor and sum(not given for edge, given in others.items() if edge != approach) > 1:
        return "a third arm is a main road too"
    return ""


def _choice(here: PlateHere) -> str:
    approach = here.ahead.edges[-1]
    turns = [here.scene.roads.graph.turn(approach, e) for e in here.scene.roads.ways_on(approach)]
    if len(turns) < 2:
        return f"{len(turns) or 'no'} way on: no choice"
    permitted = [turn in here.sign.rule.options["allowed"] for turn in turns]
    if not any(permitted):
        return "permits no way on"
    if all(permitted):
        return "permits all ways on"
    return ""


def _shown(here: PlateHere) -> str:
    approach, allowed = here.ahead.edges[-1], set(here.sign.rule.options["allowed"])
    there = {here.scene.roads.graph.turn(approach, e) for e in here.scene.roads.ways_on(approach)}
    shown = set(TURNS) - allowed if here.plate.code.startswith(_FORBIDS_TURNS) else allowed
    missing = sorted(shown - there - {U_TURN})
    return f"shows {' and '.join(missing)}, which is not there" if missing else ""


def _open_road(here: PlateHere) -> str:
    plate, roads = here.plate, here.scene.roads
    road = roads.back(edge=plate.edge, s=plate.position_m).edges
    for edge in road:
        if code := here.closing(edge):
            return f"{code} closes its road"
    other = roads.other_direction({*road, *here.ahead.edges})
    if any(p.code == CLOSED and p.edge in other for p in here.scene.plates):
        return f"{CLOSED} closes its road in both directions"
    allowed = here.sign.rule.options.get("allowed")
    if allowed is None or not here.ahead.junction:
        return ""
    approach = here.ahead.edges[-1]
    permitted = [e for e in roads.ways_on(approach) if roads.graph.turn(approach, e) in allowed]
    asks = any if here.plate.code.startswith(_ORDERS_TURNS) else all
    return "its way is closed" if permitted and asks(map(here.closing, permitted)) else ""


def _enterable(here: PlateHere) -> str:
    approach, roads = here.ahead.edges[-1], here.scene.roads
    for edge in roads.ways_on(approach):
        if not (here.closing(edge) or any(here.lets(a, edge) for a in roads.ways_to(edge))):
            return f"with the other plates nobody may enter {edge}"
    ways, turn = roads.ways_on(approach), roads.graph.turn
    ahead = [e for e in ways if turn(approach, e) == STRAIGHT]
    if len(ways) == 2 and ahead and not any(here.lets(approach, e) for e in ahead):
        back = roads.other_direction([approach])
        facing = [(a, e) for e in back for a in roads.ways_to(e) if turn(a, e) == STRAIGHT]
        if facing and not any(here.lets(a, e) for a, e in facing):
            return "with the other plates nobody may go straight on over the side road"
    return ""


def _onward(here: PlateHere) -> str:
    if here.plate.role == TARGET:
        return ""
    approach, roads = here.ahead.edges[-1], here.scene.roads
    kept = roads.main_ways(approach) if here.at_target(_MINOR + _MAJOR) else set()
    if len(roads.network.edges[approach].lanes) > 1:
        kept |= {e for e in roads.ways_on(approach) if roads.graph.turn(approach, e) == STRAIGHT}
    turned = sorted(e for e in kept if not here.permits(approach, e) and not here.closing(e))
    return f"turns traffic off its road, which goes on to {turned[0]}" if turned else ""


def _one_way_across(here: PlateHere) -> str:
    onto, against = here.across
    if onto and here.at_target(ONE_WAY):
        # That road has lanes both ways in both halves, and no vehicle uses it.
        used = [v.id for v in here.scene.vehicles if not against.isdisjoint(v.edges)]
        return f"{used[0]} drives against it on the crossing road" if used else ""
    if any(_has_lane_against(here.scene.roads.network, edge) for edge in onto):
        return "a lane leads against the crossing road"
    return "" if onto and not against else "the crossing road is not one-way in its direction"


def _obstacle(here: PlateHere) -> str:
    line = here.scene.roads.network.edge_lanes(here.plate.edge)[0].line
    place = line.project(here.plate.x, here.plate.y)[0]
    for o in here.scene.obstacles:
        lane = here.scene.roads.network.lane(o.lane)
        before = line.project(o.x, o.y)[0] - place
        if lane.edge == here.plate.edge and -o.length / 2 <= before <= o.length / 2 + here.farthest:
            return ""
    return "no obstacle is there"


def _several_lanes(here: PlateHere) -> str:
    lanes = len(here.scene.roads.network.edges[here.plate.edge].lanes)
    return "" if lanes > 1 else "one lane in that direction"


def _by_its_lane(here: PlateHere) -> str:
    if here.plate.lane < 1:
        return ""
    lane = here.scene.roads.network.edge_lanes(here.plate.edge)[here.plate.lane]
    aside = abs(lane.line.project(here.plate.x, here.plate.y)[1])
    return "" if aside <= lane.width / 2 else f"hangs {aside:.1f} m beside its lane"


def _kerb_lane(here: PlateHere) -> str:
    return "" if here.plate.lane < 1 else "its lane lies between lanes for cars"


def _contraflow(here: PlateHere) -> str:
    there = _has_lane_against(here.scene.roads.network, here.plate.edge)
    return "" if there else "no lane against a one-way road"


def _has_lane_against(network: RoadNetwork, name: str) -> bool:
    """Has a one-way road a lane for others than cars in the other direction?"""
    edge = network.edges[name]
    against = (e for e in network.edges.values() if (e.source, e.target) == (edge.target, edge.source))
    return any(e.lanes and all(is_reserved(network.lanes[i]) for i in e.lanes) for e in against)


def _mouth(here: PlateHere) -> str:
    most = here.scene.catalog.distances.mouth_m
    behind = here.scene.roads.back(edge=here.plate.edge, s=here.plate.position_m)
    if not behind.junction:
        return "no junction is behind it"
    return "" if behind.distance <= most else f"stands {behind.distance:.0f} m behind the junction, not at its mouth"


def _unentered(here: PlateHere) -> str:
    plate = here.plate
    past = [v.id for v in here.bound if v.passes(edge=plate.edge, s=plate.position_m)]
    if past:
        return f"{past[0]} drives past it"
    behind = [p.code for p in here.scene.plates if plate.role != TARGET and here.is_before(p)]
    return f"{behind[0]} stands on the road that it closes" if behind else ""


def _unused(here: PlateHere) -> str:
    plate, roads = here.plate, here.scene.roads
    ahead = roads.approach(edge=plate.edge, s=plate.position_m).edges
    road = {*ahead, *roads.back(edge=plate.edge, s=plate.position_m).edges}
    road |= roads.other_direction(road)
    used = [v.id for v in here.bound if not road.isdisjoint(v.edges)]
    return f"{used[0]} drives on its road" if used else ""


def _entered(here: PlateHere) -> str:
    rule = here.sign.rule.name
    targets = (here.scene.catalog.sign(p.code) for p in here.scene.plates if p.role == TARGET)
    return "" if any(sign.rule.name == rule for sign in targets) else _mouth(here)


def _begin(here: PlateHere) -> str:
    begin, plate = here.sign.ends or "", here.plate
    behind = here.scene.roads.back(edge=plate.edge, s=plate.position_m)
    distance = 0.0
    for name in behind.edges:
        before = plate.position_m if name == plate.edge else math.inf
        distance += min(before, here.scene.roads.length(name))
        there = [
            p for p in here.scene.plates if p.edge == name and p.code in (begin, plate.code) and p.position_m < before
        ]
        if there:
            last = max(there, key=lambda p: p.position_m)
            if last.code == plate.code:
                return "another end stands before it"
            if last.value != plate.value:
                return f"the {begin} before it sets {last.value or 0:g} km/h"
            long = distance - last.position_m
            return "" if long >= here.scene.catalog.distances.zone_m else f"the {begin} stands {long:.0f} m before it"
    if any(p.code == begin and p.value == plate.value and here.is_before(p) for p in here.scene.plates):
        return f"its {begin} stands behind it"
    if behind.junction and here.scene.catalog.sign(begin).rule.ends_at_junction:
        return f"no {begin} stands between the junction and it"
    return ""


def _road_speed(here: PlateHere) -> str:
    road = here.scene.roads.network.edges[here.plate.edge].road_class
    allowed = here.scene.catalog.allowed_speeds(road_class=road, code=here.sign.ends or here.plate.code)
    value = here.sign.effective_value(here.plate.value)
    if allowed is None or value in allowed:
        return ""
    return f"{value:g} km/h on a {road.removeprefix('highway.')} road"


def _not_before_yield(here: PlateHere) -> str:
    later = [p.code for p in here.scene.plates if p.code in _MINOR and here.is_before(p)]
    return f"{later[0]} stands behind it" if later else ""


def _crossing(here: PlateHere) -> str:
    x, y = here.plate.x, here.plate.y
    for crossing in here.scene.roads.network.crossings.values():
        line = crossing.line
        s = min(max(line.project(x, y)[0], 0.0), line.length)
        if math.dist(line.point_at(s), (x, y)) <= crossing.width / 2 + PLATE_SIDE_M[1] + here.farthest:
            return ""
    return "no crossing is there"


def _ring(here: PlateHere) -> str:
    return "" if here.scene.roads.leads_to_ring(here.ahead.edges[-1]) else "no ring is there"


def _alone(here: PlateHere) -> str:
    for plate in here.scene.plates:
        other = PlateHere(here.scene, plate)
        rule = other.sign.rule.name
        rules = {rule, here.sign.rule.name}
        alike = len(rules) == 1 or any(rules <= group for group in _NEVER_TOGETHER)
        roles, another = {plate.role, here.plate.role}, plate.value != here.plate.value
        follows = roles == {TARGET} or (TARGET in roles and plate.code == here.plate.code and another)
        if plate.id == here.plate.id or other.sign.is_end or not alike or follows:
            continue
        for first, second in ((here, other), (other, here)):
            if first.is_before(second.plate) and not _is_over(first, second.plate):
                return f"{plate.code} stands on the same road"
    return ""


def _both_ways(here: PlateHere) -> str:
    plate, roads = here.plate, here.scene.roads
    if roads.one_way(plate.edge):
        return ""
    signs = here.scene.catalog.signs
    wanted = here.sign.ends or next((word for word in here.sign.rule.ended_by if word in signs), plate.code)
    # Where a zone ends another may begin: its plate is enough.
    rule = here.sign.rule
    zones = {code for code, s in signs.items() if "both_ways" in s.places and s.rule.name == rule.name and not s.is_end}
    most = here.scene.catalog.distances.beside_m
    cos, sin = math.cos(plate.heading), math.sin(plate.heading)
    for other in here.scene.plates:
        another = not here.sign.is_end and other.code in zones and other.value != plate.value
        if another or (other.code, other.value) == (wanted, plate.value):
            dx, dy = other.x - plate.x, other.y - plate.y
            across = (dy * cos - dx * sin) * (-1.0 if roads.network.left_hand else 1.0)
            against = math.cos(other.heading - plate.heading) < _AGAINST
            if against and abs(dx * cos + dy * sin) <= most and 0.0 < across <= _ACROSS_M:
                return ""
    return f"no {wanted} faces the other direction"


def _own_direction(here: PlateHere) -> str:
    plate, roads = here.plate, here.scene.roads
    if plate.code == "3.1" and roads.one_way(plate.edge):
        return "closes a one-way road in its only direction"
    for target in here.scene.plates:
        if target.role == TARGET and target.code in ONE_WAY:
            ahead = roads.approach(edge=target.edge, s=target.position_m)
            across = roads.across(ahead.edges[-1]) if ahead.junction else {}
            if any(plate.edge in out | into for out, into in across.values()):
                return f"on the road across the {target.code}, which alone says its direction"
    return ""


def _lasting(here: PlateHere) -> str:
    short = here.ahead.distance < here.scene.catalog.distances.zone_m
    return f"stands {here.ahead.distance:.0f} m before the junction where it ends" if short else ""


def _is_over(here: PlateHere, before: SignInstance) -> bool:
    """Does an end of the plate stand between it and another plate?"""
    ends = (p for p in here.scene.plates if p.code in here.sign.rule.ended_by and here.is_before(p))
    return any(PlateHere(here.scene, p).is_before(before) for p in ends)


# The check of a kind of place is the function of its name.
_CHECKS: dict[Place, Callable[[PlateHere], str]] = {place: globals()[f"_{place}"] for place in get_args(Place)}
