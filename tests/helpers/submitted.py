"""Of which data set the leaderboard's tests drive the dev split, whole: a small one with all that Moscow's has."""

from tsbench.run.edition import in_force

TOWN = "north-bayreuth"


def edition() -> str:
    """Its edition, as pages name it."""
    return f"{TOWN}-{in_force().name}"
