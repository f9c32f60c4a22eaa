"""CommonRoad (TU Munich): scenes as its scenarios, live, and its reactive planner, driven as it is.

Its packages insist on a protobuf that Ray and TensorBoard refuse, so they go into an environment of their own: the
extra `commonroad`, Python 3.11 (docs/adapters.md).
"""

from tsbench.core.errors import InputError

try:
    import commonroad_dc.pycrcc  # noqa: F401
    import commonroad_rp  # noqa: F401
except ImportError as missing:
    raise InputError(
        f"tsbench.bridges.commonroad: {missing}. It needs the extra `commonroad` in an environment of its own, with "
        "Python 3.11 (docs/adapters.md)"
    ) from missing

from tsbench.bridges.commonroad.reactive import Reactive
from tsbench.bridges.commonroad.scenario import LiveScenario

__all__ = ["LiveScenario", "Reactive"]
