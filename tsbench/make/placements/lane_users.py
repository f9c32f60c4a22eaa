"""Users of a contraflow lane: buses or cyclists, held until they would meet an ego that keeps its lane.

Source: docs/scenes.md, "Reserved lanes". Units: m, s, m/s.
"""

from __future__ import annotations

from tsbench.make.placements.placement import ConvoySetup, SceneTask, require
from tsbench.make.scenes.drivers import Driver
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.network import Lane
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

# Room between the end of a lane and a body that stands on it.
_END_ROOM_M = 1.0
# On a shorter way from its stand the lead could not be timed.
_LEAST_WAY_M = 5.0
# IDM drives off at about this share of its largest acceleration.
_START_SHARE = 0.8


def lane_users(
    task: SceneTask, vclass: str, lane: Lane, edges: tuple[str, ...], before: Lane, start: EgoStart, across: float
) -> ConvoySetup:
    """The users of `lane`, who then drive over `edges`; `before`: the ego's lane, `across` from its end to theirs.

    They come towards the ego, close behind one another, and meet it front to front a little way along their lane.
    Raises UnfitMapError.
    """
    recipe, variant = task.recipe, task.variant
    driver = user_driver(recipe)
    length_m = lane.line.length
    meet = min(recipe.number("meet_m"), recipe.number("meet_share") * length_m)
    to_line = before.line.length - start.s - EGO_LENGTH_M / 2
    eta = predicted_arrival(to_line, to_line + across + meet, start.speed, before.speed, before.speed)
    zone = length_m - meet
    way = way_from_standstill(driver, recipe.number("user_time_share") * eta)
    first = driver.length + _END_ROOM_M
    lead = max(zone - way, first)
    step = -(driver.length + recipe.number("standing_gap_m"))
    counts = recipe.choices["users"]
    asked = int(counts[variant.layout % len(counts)])
    wanted = [lead + k * step for k in range(asked)]
    places = tuple(p for p in wanted if first <= p <= length_m - _END_ROOM_M)
    require(bool(places) and zone - lead >= _LEAST_WAY_M, f"the reserved lane is {length_m:.0f} m long")
    return ConvoySetup(
        drivers=(driver,) * len(places), places=places, lane=lane.id, edges=edges, zone_m=zone, line_lane=before.id,
        ego_zone_m=across + meet, ego_cruise_mps=before.speed, ego_turn_mps=before.speed, vclass=vclass,
    )  # fmt: skip


def user_driver(recipe: Recipe) -> Driver:
    """The recipe's bus or cyclist. Its headway is from front to front, IDM's is the gap: less its own length."""
    speed, length, gap = (recipe.number(f"user_{k}") for k in ("speed_mps", "length_m", "gap_m"))
    return Driver(
        speed=speed,
        accel=recipe.number("user_accel_mps2"),
        decel=recipe.number("user_decel_mps2"),
        headway=recipe.number("user_headway_s") - (length + gap) / speed,
        gap=gap,
        length=length,
        width=recipe.number("user_width_m"),
    )


def way_from_standstill(driver: Driver, time: float) -> float:
    """How far a vehicle gets in a time (s): a ramp, then its cruise speed."""
    accel = _START_SHARE * driver.accel
    ramp = driver.speed / accel
    if time <= ramp:
        return 0.5 * accel * time * time
    return 0.5 * driver.speed * ramp + driver.speed * (time - ramp)
