"""Of which data set the leaderboard's tests drive the dev split, whole: a small one with all that Moscow's has."""

from tsbench.run.edition import in_force
from tsbench.scenarios.data_set import DataSet

TOWN = "north-bayreuth"


def edition() -> str:
    """Its edition, as pages name it."""
    return f"{TOWN}-{in_force(DataSet(TOWN)).name}"
