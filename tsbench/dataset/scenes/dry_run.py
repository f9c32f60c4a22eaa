"""A short run without the ego while scenes are built: how long the convoy's lead takes."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.errors import SimulationError
from tsbench.roads.network import RoadNetwork
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

LEAD_LIMIT_S = 40.0


def lead_time(
    sim: Simulation, net: Path, additional: Path, network: RoadNetwork, seed: int, way_m: float
) -> float:
    """Seconds from standing start until the convoy's lead has its front `way_m` further on.

    Raises SimulationError if it does not get there within 40 s.
    """
    sim.load(net, additional, network, seed)
    sim.step()
    convoy = [name for name, *_ in sim.fleet()]
    for vehicle in convoy:
        sim.hold(vehicle)
    sim.step()
    began = sim.distance_driven("convoy_0")
    for vehicle in convoy:
        sim.release(vehicle)
    for tick in range(1, int(LEAD_LIMIT_S / DT_S)):
        sim.step()
        if sim.distance_driven("convoy_0") - began >= way_m:
            return tick * DT_S
    raise SimulationError(f"{additional}: the convoy's lead does not reach the conflict zone")
