"""From a city's extracts to its certified data set: the pool, the scenes of every type, the name of its contract."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.make.city import chosen_city
from tsbench.make.maps.ground import write_ground
from tsbench.make.maps.harvest import harvest
from tsbench.make.maps.paths import made_pool
from tsbench.make.scenes.build import BuildRequest, Progress, TypeReport, build_scenarios
from tsbench.make.scenes.overview import build_report, carried
from tsbench.make.scenes.recipe import load_recipes
from tsbench.run.edition import editions, release_city
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool


def build_city(
    types: tuple[str, ...],
    osm: Path,
    workers: int,
    progress: Progress,
    on_progress: Callable[[str], None] = lambda _: None,
) -> list[TypeReport]:
    """Build the data set of the city in use, of some types or () = all. Interrupted, it goes on where it was.

    on_progress: gets a line for each thing in the extracts that was not taken as it is.

    Raises InputError: an extract that is missing or another than the city's, or lies in another zone; no scenario.
    """
    city = chosen_city()
    if city.name == OWN_CITY:
        raise InputError(
            f"{city.name} is the benchmark's own: tsbench maps harvest and tsbench scenarios build make its data set"
        )
    pool = made_pool()
    for note in harvest(osm, pool, pool.with_name("harvest.json"), workers, progress).notes:
        on_progress(note)
    reports = build_scenarios(BuildRequest(types, osm, DataSet.in_use().folder / "scenarios", workers), progress)
    if not any(DataSet.in_use().table(split) for split in DataSet.in_use().splits):
        why = dict.fromkeys(
            c.why for c in carried(city, read_pool(pool), load_recipes(DataSet.in_use().catalog, types), build_report())
        )
        raise InputError(
            f"{city.name}: its {len(read_pool(pool)):,} maps carry no scenario: {next(iter(why))}"
            f"{f', and {len(why) - 1} more reasons' if len(why) > 1 else ''} (tsbench city show {city.name})"
        )
    DataSet.in_use().write_editions(dict.fromkeys(DataSet.in_use().splits, editions()[-1].name))
    release_city(DataSet.in_use(), city.title)
    write_ground(osm)
    return reports
