"""The bus refuses floods by the real clock; a test whose clock runs faster than that looks like one."""

from __future__ import annotations

import pytest

from services.runtime import bus


@pytest.fixture(autouse=True)
def faster_than_real(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus, "FLOOD_FACTOR", 1e6)
