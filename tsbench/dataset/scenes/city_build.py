"""From a city's extracts to its certified data set: the pool, the scenes of every type, the name of its contract."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY, dataset_root
from tsbench.dataset.city import chosen_city
from tsbench.dataset.maps.harvest import harvest
from tsbench.dataset.maps.paths import made_pool
from tsbench.dataset.scenes.build import BuildRequest, Progress, TypeReport, build_scenarios
from tsbench.run.edition import release_city


def build_city(types: tuple[str, ...], osm: Path, workers: int, progress: Progress) -> list[TypeReport]:
    """Build the data set of the city in use, of some types or () = all. Interrupted, it goes on where it was.

    Raises InputError: an extract that is missing or another than the city's, or lies in another zone.
    """
    city = chosen_city()
    if city.name == OWN_CITY:
        raise InputError(
            f"{city.name} is the benchmark's own: tsbench maps harvest and tsbench scenarios build make its data set"
        )
    pool = made_pool()
    harvest(osm, pool, pool.with_name("harvest.json"), workers, progress)
    reports = build_scenarios(BuildRequest(types, osm, dataset_root() / "scenarios", workers), progress)
    release_city(city.title)
    return reports
