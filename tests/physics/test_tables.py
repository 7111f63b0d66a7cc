"""Tools travel as tables: what physics takes out of them and puts into them is what their names say."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.conftest import Rig
from trocar.protocol.bodies import HeldPoint, ToolContacts, ToolReaction, ToolState
from trocar.protocol.bodies.haptics import TOOL_COLUMNS, tool_table
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.physics.inputs import ContactsReader
from trocar.services.physics.outputs import Outputs

FAR = (0.02, -0.05, 0.08)
TOOLS = [
    ToolState(position_m=(1.0, 2.0, 3.0), port_m=(4.0, 5.0, 6.0), roll_rad=7.0, jaw_angle_rad=8.0),
    ToolState(position_m=(-1.0, -2.0, -3.0), port_m=(-4.0, -5.0, -6.0), roll_rad=-7.0, jaw_angle_rad=-8.0),
    ToolState(position_m=(0.1, 0.2, 0.3)),
]


def frame(*tools: ToolState, holds: tuple[HeldPoint, ...] = ()) -> ToolContacts:
    return ToolContacts(tick=0, tools=tool_table(tools), holds=holds)


def test_rows_are_what_their_names_say() -> None:
    assert [ToolState.from_row(row) for row in tool_table(TOOLS).view().tolist()] == TOOLS
    numbered = ToolReaction.from_row([float(number) for number in range(27)])
    assert reaction_table([numbered]).view().tolist() == [[float(number) for number in range(27)]]
    assert (numbered.force_n, numbered.position_m) == ((0.0, 1.0, 2.0), (23.0, 24.0, 25.0))
    assert (numbered.grasp_torque_nm, numbered.proxy_jaw_angle_rad, numbered.contacts, numbered.holds) == (
        18.0, 20.0, 21, 22,
    )  # fmt: skip


def test_a_count_that_is_none_is_no_error_of_who_looks_on() -> None:
    row = [0.0] * 27
    row[21], row[22] = -3.0, 1e300
    shown = ToolReaction.from_row(row)
    assert shown.contacts == 0
    assert shown.holds > 0


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_the_tools_of_a_frame_are_taken_as_far_as_there_is_room(rig: Rig, n: int) -> None:
    simulation = rig.physics.simulation
    reader = ContactsReader(simulation)
    assert reader.read_contacts(frame(*TOOLS[:2]))
    tools, there = reader.tools, min(n, 2)
    before = tools.position_m.copy()
    moved = [ToolState(position_m=(9.0 + i, 0.0, 0.0), port_m=(0.0, 0.0, 1.0 + i)) for i in range(n)]
    assert reader.read_contacts(frame(*moved))
    assert tools.present.tolist() == [i < there for i in range(2)]
    for i in range(2):
        if i < there:
            assert tuple(tools.position_m[i]) == moved[i].position_m
            assert tuple(simulation.tools.port_m[i]) == moved[i].port_m
        else:
            np.testing.assert_array_equal(tools.position_m[i], before[i])


def test_every_number_of_a_tool_arrives_in_its_place(rig: Rig) -> None:
    reader = ContactsReader(rig.physics.simulation)
    assert reader.read_contacts(frame(*TOOLS[:2]))
    tools = reader.tools
    for i, told in enumerate(TOOLS[:2]):
        assert tuple(tools.position_m[i]) == told.position_m
        assert tuple(rig.physics.simulation.tools.port_m[i]) == told.port_m
        assert (tools.roll_rad[i], tools.jaw_angle_rad[i]) == (told.roll_rad, told.jaw_angle_rad)


def test_a_frame_that_is_refused_moves_no_tool(rig: Rig) -> None:
    reader = ContactsReader(rig.physics.simulation)
    hold = HeldPoint(
        hold_id=1, tool=0, target_kind=0, target=10**6, target_weights=(1.0, 0.0, 0.0), limit_n=1.0, jaw_angle_rad=0.1
    )
    assert reader.read_contacts(frame(*TOOLS[:2]))
    assert not reader.read_contacts(frame(*TOOLS[1:], holds=(hold,)))
    assert tuple(reader.tools.position_m[0]) == TOOLS[0].position_m


def test_what_tools_feel_is_what_was_solved_about_the_hands_of_the_frame(rig: Rig) -> None:
    for k in range(120):
        rig.turn((0.02, 0.0, 0.010 - 0.004 * min(1.0, k / 60)), FAR)
    simulation = rig.physics.simulation
    outputs = Outputs(simulation, "")
    state = outputs.state(7, tool_table(TOOLS[:2]))
    results = simulation.tool_results
    for i, felt in enumerate(state.reactions()):
        assert felt.force_n == tuple(results.force_n[i])
        assert felt.port_moment_nm == tuple(results.port_moment_nm[i])
        assert felt.stiffness_n_m == tuple(results.stiffness_n_m[i].ravel())
        assert felt.proxy_position_m == tuple(results.proxy_position_m[i])
        assert felt.proxy_jaw_angle_rad == results.proxy_jaw_angle_rad[i]
        assert felt.grasp_torque_nm == results.grasp_torque_nm[i]
        assert felt.grasp_stiffness_nm_rad == results.grasp_stiffness_nm_rad[i]
        assert (felt.position_m, felt.jaw_angle_rad) == (TOOLS[i].position_m, TOOLS[i].jaw_angle_rad)
    assert state.reactions()[0].contacts > 0
    assert np.linalg.norm(state.reactions()[0].force_n) > 0.0


@pytest.mark.parametrize("n", [0, 1, 3])
def test_as_many_reactions_are_sent_as_hands_came_and_mechanics_knows(rig: Rig, n: int) -> None:
    state = Outputs(rig.physics.simulation, "").state(7, tool_table(TOOLS[:n]))
    assert len(state.reactions()) == min(n, 2)
    assert tool_table(TOOLS[:n]).shape == (n, TOOL_COLUMNS)
