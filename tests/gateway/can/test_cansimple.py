"""The codec against a DBC file read by cantools: two writings of the same table."""

from __future__ import annotations

import struct

import cantools
import pytest

from trocar.services.gateway.can import cansimple
from trocar.services.gateway.can.cansimple import AxisError, AxisState
from trocar.services.runtime.config import config

DBC = cantools.database.load_file(config.config_directory() / "devices" / "odrive.dbc")
COMMANDS = {
    "Get_Version": cansimple.GET_VERSION,
    "Heartbeat": cansimple.HEARTBEAT,
    "Estop": cansimple.ESTOP,
    "Get_Error": cansimple.GET_ERROR,
    "Set_Axis_State": cansimple.SET_AXIS_STATE,
    "Get_Encoder_Estimates": cansimple.GET_ENCODER_ESTIMATES,
    "Set_Controller_Mode": cansimple.SET_CONTROLLER_MODE,
    "Set_Input_Torque": cansimple.SET_INPUT_TORQUE,
    "Set_Limits": cansimple.SET_LIMITS,
    "Get_Temperature": cansimple.GET_TEMPERATURE,
    "Clear_Errors": cansimple.CLEAR_ERRORS,
    "Get_Torques": cansimple.GET_TORQUES,
}


def test_every_command_has_the_identifier_of_the_dbc() -> None:
    assert {message.name: message.frame_id for message in DBC.messages} == {
        name: cansimple.identifier(1, command) for name, command in COMMANDS.items()
    }


def _dbc(name: str, *values: float) -> bytes:
    message = DBC.get_message_by_name(name)
    return bytes(message.encode(dict(zip((signal.name for signal in message.signals), values, strict=True))))


def test_payloads_are_those_of_the_dbc() -> None:
    assert cansimple.pack_float(0.1) == _dbc("Set_Input_Torque", 0.1) == bytes.fromhex("cdcccc3d")
    assert cansimple.pack_floats(1.5, -2.25) == _dbc("Get_Encoder_Estimates", 1.5, -2.25)
    assert cansimple.pack_floats(20.0, 10.0) == _dbc("Set_Limits", 20.0, 10.0)
    assert cansimple.pack_word(AxisState.CLOSED_LOOP) == _dbc("Set_Axis_State", 8)
    assert cansimple.pack_words(1, 6) == _dbc("Set_Controller_Mode", 1, 6)
    heartbeat = cansimple.pack_heartbeat(AxisError.ESTOP_REQUESTED, AxisState.IDLE, 3, True)
    assert heartbeat == _dbc("Heartbeat", 0x2000000, 1, 3, 1)


def test_payloads_of_the_dbc_are_read_back() -> None:
    assert cansimple.unpack_heartbeat(_dbc("Heartbeat", 0x1000000, 8, 0, 0)) == (0x1000000, 8)
    assert cansimple.unpack_floats(_dbc("Get_Encoder_Estimates", 0.25, -1.0)) == (0.25, -1.0)
    assert cansimple.unpack_words(_dbc("Get_Error", 5, 7)) == (5, 7)
    assert cansimple.unpack_words(_dbc("Set_Axis_State", 8)) == (8,)


@pytest.mark.parametrize("length", [0, 3, 7])
def test_a_payload_of_another_length_is_refused(length: int) -> None:
    for unpack in (cansimple.unpack_heartbeat, cansimple.unpack_floats, cansimple.unpack_float, cansimple.unpack_words):
        with pytest.raises(struct.error):
            unpack(bytes(length))


def test_errors_are_told_by_name() -> None:
    assert cansimple.error_names(0x1000000 | 0x2000000 | 0x40) == "WATCHDOG_TIMER_EXPIRED, ESTOP_REQUESTED, 0x40"
