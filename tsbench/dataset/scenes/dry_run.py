"""A short run without the ego while scenes are built: how long the convoy's lead takes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tsbench.core.errors import SimulationError
from tsbench.roads.network import RoadNetwork
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

LEAD_LIMIT_S = 40.0
LEAD_ID = "convoy_0"


def load_files(sim: Simulation, net: Path, additional: Path, network: RoadNetwork, seed: int) -> None:
    """As `Simulation.load`, also where a path has commas: SUMO takes them for the ends of names."""
    with _without_commas(net) as plain_net, _without_commas(additional) as plain_additional:
        sim.load(plain_net, plain_additional, network, seed)


@contextmanager
def _without_commas(path: Path) -> Iterator[Path]:
    """A path at which this process reads the same file for as long as this lasts."""
    if "," not in str(path):
        yield path
        return
    with path.open("rb") as file:
        yield Path(f"/proc/self/fd/{file.fileno()}")


def lead_time(
    sim: Simulation, net: Path, additional: Path, network: RoadNetwork, seed: int, way_m: float
) -> float:
    """Seconds until the convoy's lead has its front `way_m` further on, from its standing start or its entry.

    Raises SimulationError if it does not get there within 40 s.
    """
    load_files(sim, net, additional, network, seed)
    sim.step()
    convoy = [name for name, *_ in sim.fleet()]
    for vehicle in convoy:
        sim.hold(vehicle)
    sim.step()
    while not sim.is_there(LEAD_ID) and sim.time() < LEAD_LIMIT_S:
        sim.step()
    began = sim.distance_driven(LEAD_ID)
    for vehicle in convoy:
        sim.release(vehicle)
    for tick in range(1, int(LEAD_LIMIT_S / DT_S)):
        sim.step()
        if sim.distance_driven(LEAD_ID) - began >= way_m:
            return tick * DT_S
    raise SimulationError(f"{additional}: the convoy's lead does not reach the conflict zone")
