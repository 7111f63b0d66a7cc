"""A bus that is opened while the servo goes on: whatever happens there is told, and the servo has a bus or none."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import can
import pytest

from trocar.services.gateway.can import canbus, shared_bus
from trocar.services.gateway.devices.background_open import BackgroundOpen
from trocar.services.runtime.errors import DeviceError


class _StrangeError(Exception):
    """As termios.error: what plug-ins of python-can raise need not be an OSError."""


def _raise(**_: Any) -> can.BusABC:
    raise _StrangeError("Input/output error")


def test_a_bus_that_cannot_be_opened_is_one_sentence_whatever_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can, "Bus", _raise)
    with pytest.raises(DeviceError, match="'left': CAN bus other can7 cannot be opened: Input/output error"):
        canbus.open_bus({"interface": "other", "channel": "can7"}, "instrument 'left'")


@pytest.mark.parametrize(
    ("error", "why"), [(DeviceError("no bus"), "no bus"), (_StrangeError("gone"), "gone"), (KeyError(), "KeyError")]
)
def test_why_there_is_no_bus_is_told_whatever_is_raised(error: Exception, why: str) -> None:
    """Without a word the handle took the bus that it had given up for one that is open."""

    def fail() -> can.BusABC:
        raise error

    assert BackgroundOpen(fail).take() == (None, why)


class _Line:
    """A serial line; only whether it is open is looked at."""

    is_open = True

    def __init__(self, **_: Any) -> None:
        pass

    def shutdown(self) -> None:
        self.is_open = False


def test_who_leaves_does_not_close_an_adapter_that_another_is_just_taking(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Two handles whose drives are silent open theirs anew in the same tick, each in a thread of its own."""
    settings = {"channel": str(tmp_path / "adapter")}
    right = shared_bus.share(settings, _Line)
    leaving = threading.Thread(target=right.shutdown)
    place = shared_bus.SharedBus

    def take(adapter: Any) -> shared_bus.SharedBus:
        leaving.start()
        leaving.join(0.2)  # it leaves before, if nobody keeps it
        return place(adapter)

    monkeypatch.setattr(shared_bus, "SharedBus", take)
    left = shared_bus.share(settings, _Line)
    leaving.join()
    assert left._adapter.bus.is_open
    left.shutdown()
    assert not left._adapter.bus.is_open
