from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_bench import LEFT, RIGHT, HdapiBench, two_arms


@pytest.fixture
def arms(tmp_path: Path) -> Iterator[HdapiBench]:
    """Return two arms of a stand-in of the vendor's library, not yet open."""
    try:
        with two_arms(tmp_path) as bench:
            yield bench
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


@pytest.fixture(params=["force", "law"])
def pushing(arms: HdapiBench, request: pytest.FixtureRequest) -> HdapiBench:
    """Return both arms under the full force that was asked for: ordered as it is, or as a law."""
    arms.by_law = request.param == "law"
    arms.open()
    arms.begin(LEFT, RIGHT)
    np.testing.assert_allclose(arms.forces[-1], [LEFT, RIGHT])
    return arms
