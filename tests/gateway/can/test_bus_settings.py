"""What a rig file may say of a handle's CAN bus: no key is passed over, and a speed is a number."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

import can
import pytest

from tests.gateway.can.test_can_buses import load
from tests.gateway.can.virtual_node import VirtualNode
from trocar.services.gateway.can import canbus
from trocar.services.runtime.errors import ConfigError


@pytest.mark.parametrize("bitrate", [0, -500_000, "fast", None, True, float("nan")])
def test_a_bus_whose_speed_is_none_is_one_sentence(tmp_path: Any, bitrate: Any) -> None:
    bus, node = {"interface": "virtual", "channel": str(tmp_path), "bitrate": bitrate}, VirtualNode(str(tmp_path))
    with pytest.raises(ConfigError, match=r"^instrument 'left', driver 'grasp_odrive_can': bus: .*bitrate must be"):
        load(bus, node)
    node.close()


@pytest.mark.parametrize(
    ("bus", "sentence"),
    [
        ({"interfaec": "socketcan", "channel": "can0"}, "interface: this key is missing; given: interfaec, channel"),
        ({}, "interface: this key is missing; given: none"),
        ({"interface": "socketcan", "chanel": "can0"}, "unknown key 'chanel'; known: interface, bitrate, channel, "),
        ({"interface": "socketcan"}, "channel: this key is missing"),
        ({"interface": "slcan", "channel": "/dev/ttyACM0", "bitrat": 500_000}, "unknown key 'bitrat'; known: "),
        ({"interface": "udp_multicast", "channel": "239.0.0.1", "hops": 0}, "unknown key 'hops'; known: "),
        ({"interface": "udp_multicast", "channel": "239.0.0.1"}, "on udp_multicast everybody on the network can move"),
        ({"interface": "virtual", "channel": "a", "can_filters": []}, "unknown key 'can_filters'; known: "),
    ],
)
def test_a_misspelt_key_of_a_bus_is_not_passed_over(tmp_path: Path, bus: dict[str, Any], sentence: str) -> None:
    """As python-can does: a handle whose `channel` is misspelt would hear every bus of the machine."""
    node = VirtualNode(str(tmp_path))
    with pytest.raises(
        ConfigError, match=rf"^instrument 'left', driver 'grasp_odrive_can': bus: .*{re.escape(sentence)}"
    ):
        load(bus, node)
    node.close()


@pytest.mark.parametrize("interface", list(canbus.KEYS))
def test_the_keys_of_a_bus_are_those_of_the_library(interface: str) -> None:
    module, name = can.interfaces.BACKENDS[interface]
    taken = set(inspect.signature(getattr(importlib.import_module(module), name).__init__).parameters)
    filters = {"self", "kwargs", "can_filters", "protocol", "timing", "bitrate"}  # no numbers or words of a file
    assert set(canbus.KEYS[interface]) == taken - filters
