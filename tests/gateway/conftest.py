from __future__ import annotations

import pytest

from services.gateway import canbus
from services.gateway.drivers import grasp_simulated
from services.runtime.errors import DeviceError


@pytest.fixture(scope="session")
def multicast() -> None:
    """Skip where this host cannot send multicast to itself."""
    try:
        canbus.open_bus(grasp_simulated.private_bus(), "test").shutdown()
    except DeviceError as error:
        pytest.skip(str(error))
