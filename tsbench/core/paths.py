"""Where the data lies: one lookup for what is read, one folder for what is made.

Names are relative to a root, with slashes: `sign_catalog`, `scenarios/test.parquet`, `sumo_nets/pool.parquet`.
A folder named by TSBENCH_DATA, or else the clone that this package lies in, is the only root. A tsbench that was
installed from its wheel has three: the package itself (the catalogue), the package `tsbench_data` (what the test split
needs), and a folder of the user, of this version, for what `tsbench data fetch` brings.

The benchmark's own data set is in the folders just named; that of a city which was built here is in folders of the
same names below `cities/data/<city>`. `--city`, or else TSBENCH_CITY, names a city; `driven_city` is the data set that
is driven for it: of one with traffic on the left, its mirror.
"""

from __future__ import annotations

import os
import re
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

import platformdirs

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.textfile import read_yaml

CITY, OWN_CITY = "TSBENCH_CITY", "moscow"
# Those whose data sets are released (`core.fetch`): their contracts are, too.
SHIPPED_CITIES = ("andorra", "north-bayreuth")
# Before a city's name: its data set in a mirror, made of the stored one as it is read, with traffic on the left.
MIRRORED = "mirrored-"
_LONGEST = 100
_PACKAGE = Path(__file__).resolve().parents[1]


@cache
def data_root() -> Path:
    """The folder that data is made in: TSBENCH_DATA, or the clone. Raises InputError where there is neither."""
    root = _own_root()
    if root is None:
        raise InputError("making data needs a folder that holds it all: set TSBENCH_DATA to a clone of the repository")
    if not (root / "sign_catalog").is_dir():
        raise InputError(f"{root}: no sign_catalog/ here (TSBENCH_DATA)")
    return root


def data_file(name: str) -> Path:
    """A file or folder of data: in the first root that has it, else where `tsbench data fetch` would put it."""
    *earlier, last = [root / name for root in roots()]
    return next((place for place in earlier if place.exists()), last)


@cache
def resolved(path: Path) -> Path:
    """The real path, asked of the file system once: what is read from data is looked for again and again."""
    return path.resolve()


def is_city_name(name: str) -> bool:
    """Can it be a city's name? No path is."""
    return len(name) <= _LONGEST and re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", name) is not None


def checked_city(name: str) -> str:
    """The name. Raises InputError for one that is no city's."""
    if not is_city_name(name):
        raise InputError(
            f"{CITY} (--city) {name!r}: a city's name is of a-z, 0-9 and '-'; there are {', '.join(city_names())}"
        )
    return name


def fetch_root() -> Path:
    return roots()[-1]


def _own_root() -> Path | None:
    named = os.environ.get("TSBENCH_DATA")
    if named:
        return expanded(named)
    return _clone(_PACKAGE)


@cache
def _clone(package: Path) -> Path | None:
    """The clone that a package lies in, asked of the file system once."""
    return package.parent if (package.parent / "sign_catalog").is_dir() else None


def roots() -> tuple[Path, ...]:
    """The folders that data is looked for in, first to last."""
    if _own_root() is not None:
        return (data_root(),)
    return (_PACKAGE, *_data_package(), platformdirs.user_data_path("tsbench") / tsbench.__version__)


@cache
def _data_package() -> tuple[Path, ...]:
    """The folder of `tsbench_data` where it is installed; InputError where it is another version's."""
    try:
        theirs = version("tsbench-data")
    except PackageNotFoundError:
        return ()
    if theirs != tsbench.__version__:
        raise InputError(
            f"tsbench {tsbench.__version__} and tsbench-data {theirs} do not belong together: "
            f"pip install tsbench-data=={tsbench.__version__}"
        )
    return installed_data()


def installed_data() -> tuple[Path, ...]:
    """The folder of `tsbench_data` where it is installed, whether it is read here or not."""
    spec = find_spec("tsbench_data")
    return tuple(Path(folder) for folder in (spec.submodule_search_locations or ())) if spec else ()


# What may stand before the file of a planner's specification: an executable of its own, a planner of nuPlan's.
_BEFORE = ("exe:", "nuplan:")


def expanded(path: str | Path) -> Path:
    """The path with `~` and `~name` at its beginning as the home folder; as it is for an unknown user."""
    return Path(os.path.expanduser(path))  # noqa: PTH111  (Path.expanduser raises for an unknown user)


def expanded_text(text: str) -> str:
    """The same of words that may begin with a path, such as `~/mine.py:Planner` and `exe:~/mine`."""
    before = next((prefix for prefix in _BEFORE if text.startswith(prefix)), "")
    return before + os.path.expanduser(text.removeprefix(before))  # noqa: PTH111


# Placements, experts and certificates know the right side only. What keeps to the left is built in a mirror, and driven
# in the mirror of that.
RIGHT, LEFT = "right", "left"


def cities_folder() -> Path:
    """Where cities are described, one file each."""
    return data_file("cities")


def city_names() -> tuple[str, ...]:
    """Cities that are described, sorted."""
    return tuple(sorted(path.stem for path in cities_folder().glob("*.yaml")))


def driven_as(name: str, side: str) -> str:
    """The data set that is driven for a city whose traffic keeps to `side`."""
    return MIRRORED + name if side == LEFT else name


def driven_city(name: str) -> str:
    """The data set that is driven where a user names a city; a name without a description stays as it is."""
    path = cities_folder() / f"{checked_city(name)}.yaml"
    return driven_as(name, _side(path) if path.is_file() else RIGHT)


@cache
def _side(path: Path) -> str:
    described = read_yaml(path, "a city")
    return str(described.get("side", RIGHT)) if isinstance(described, dict) else RIGHT
