"""Networks of maps made by hand, for every module that arranges scenes on some."""

from __future__ import annotations

import pytest
from pool_builders import Networks, prepared


@pytest.fixture(scope="module")
def networks(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Networks:
    """Each map of the module's MAPS as its type's placement prepares it."""
    folder = tmp_path_factory.mktemp("networks")
    return {type_id: prepared(folder, type_id, *made) for type_id, made in request.module.MAPS.items()}
