"""Where the tools are between two frames of physics: at the hands, held back by what they touched last."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from trocar.protocol.bodies import GatewayState, InstrumentState, ToolReaction, ToolState
from trocar.protocol.bodies.physics import REACTION_CONTACTS, reaction_table
from trocar.services.haptics.instruments import InstrumentTable
from trocar.services.haptics.reactions import Reactions
from trocar.services.haptics.tool_tracker import ToolTracker
from trocar.services.mechanics.scene import ForcepsScene, SceneModel

PORT = (0.0, 0.0, 0.1)
HIP, OTHER = (0.01, 0.0, 0.02), (-0.02, 0.01, 0.03)
FORCEPS = ForcepsScene(jaw_ratio=2.0, jaw_max_angle_rad=1.0, jaw_length_m=0.015)
JAW_A, JAW_B, SHAFT = 1, 2, 0


class Tracked:
    """A tracker and the tables that it follows, by names."""

    def __init__(self) -> None:
        self.reactions, self._instruments = Reactions(), InstrumentTable(2)
        scene = SceneModel(forceps=(FORCEPS, FORCEPS))
        self._tracker = ToolTracker(scene, self.reactions.rows, self._instruments.rows)
        self.segments_m, self.present, self.jaws = self._tracker.segments_m, self._tracker.present, self._tracker.jaws

    def take_reactions(self, reactions: Sequence[ToolReaction]) -> None:
        self.reactions.take_table(reaction_table(reactions))

    def take_hands(self, state: GatewayState) -> list[ToolState]:
        """Return what physics is told."""
        self._instruments.take_states(state.instruments)
        told = self._tracker.take_hands(self._instruments.count)
        return [ToolState.from_row(row) for row in told.view().tolist()]


@pytest.fixture
def tracker() -> Tracked:
    return Tracked()


def hands(*hips_m: tuple[float, float, float], handle_rad: float = 0.2, roll_rad: float = 0.0) -> GatewayState:
    instruments = (
        InstrumentState(name=f"{i}", position_m=hip, port_m=PORT, handle_angle_rad=handle_rad, roll_rad=roll_rad)
        for i, hip in enumerate(hips_m)
    )
    return GatewayState(tick=0, instruments=tuple(instruments))


#: The contact holds the proxy 2 mm above its hand, and the jaws open by 0.7 rad.
HELD_BACK = ToolReaction(
    position_m=HIP, proxy_position_m=(HIP[0], HIP[1], HIP[2] + 2e-3), proxy_jaw_angle_rad=0.7, contacts=1
)


def junctions(tracker: Tracked) -> np.ndarray:
    """Return J of both tools, which shaft and both jaws share."""
    shaft_end, jaw_starts = tracker.segments_m[:, SHAFT, 1], tracker.segments_m[:, JAW_A:, 0]
    np.testing.assert_array_equal(jaw_starts[:, 0], shaft_end)
    np.testing.assert_array_equal(jaw_starts[:, 1], shaft_end)
    return shaft_end.copy()


def opening_rad(tracker: Tracked, tool: int) -> float:
    jaws = tracker.segments_m[tool, JAW_A:, 1] - tracker.segments_m[tool, JAW_A:, 0]
    np.testing.assert_allclose(np.linalg.norm(jaws, axis=1), FORCEPS.jaw_length_m)
    return math.acos(float(jaws[0] @ jaws[1]) / FORCEPS.jaw_length_m**2)


def test_free_tools_are_where_the_hands_are(tracker: Tracked) -> None:
    told = tracker.take_hands(hands(HIP, OTHER))
    np.testing.assert_array_equal(junctions(tracker), [HIP, OTHER])
    np.testing.assert_array_equal(tracker.segments_m[:, SHAFT, 0], [PORT, PORT])
    assert [tool.position_m for tool in told] == [HIP, OTHER]
    assert [tool.port_m for tool in told] == [PORT, PORT]
    assert tracker.present.tolist() == [True, True]


@pytest.mark.parametrize(("handle_rad", "opening"), [(0.2, 0.4), (0.0, 0.0), (-0.3, 0.0), (0.8, 1.0)])
def test_jaws_open_by_the_ratio_between_their_stops(tracker: Tracked, handle_rad: float, opening: float) -> None:
    told = tracker.take_hands(hands(HIP, OTHER, handle_rad=handle_rad))
    assert opening_rad(tracker, 0) == pytest.approx(opening, abs=1e-7)
    assert told[0].jaw_angle_rad == opening
    assert (tracker.jaws(0).proxy_angle_rad, tracker.jaws(0).commanded_angle_rad) == (opening, opening)


def test_roll_turns_the_jaws_about_the_shaft(tracker: Tracked) -> None:
    tips = []
    for roll_rad in (0.0, 0.5 * math.pi):
        assert tracker.take_hands(hands(HIP, OTHER, roll_rad=roll_rad))[0].roll_rad == roll_rad
        tips.append(tracker.segments_m[0, JAW_A:, 1].copy())
    across = [tip[0] - tip[1] for tip in tips]
    shaft = np.subtract(HIP, PORT)
    assert across[0] @ across[1] == pytest.approx(0.0, abs=1e-12)
    assert across[1] @ shaft == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(tips[0].mean(axis=0), tips[1].mean(axis=0))


def test_a_tool_that_touches_is_held_back_and_moves_with_its_hand(tracker: Tracked) -> None:
    """What physics knows is the stretch of the coupling: it stays while the hand moves on."""
    tracker.take_reactions((HELD_BACK, ToolReaction()))
    for moved_m in (0.0, 1e-3):
        tracker.take_hands(hands((HIP[0] + moved_m, HIP[1], HIP[2]), OTHER))
        np.testing.assert_allclose(junctions(tracker), [(HIP[0] + moved_m, HIP[1], HIP[2] + 2e-3), OTHER], atol=1e-15)


def test_what_is_between_the_jaws_keeps_them_open(tracker: Tracked) -> None:
    tracker.take_reactions((HELD_BACK, ToolReaction()))
    told = tracker.take_hands(hands(HIP, OTHER))
    assert opening_rad(tracker, 0) == pytest.approx(0.7)
    assert opening_rad(tracker, 1) == pytest.approx(0.4)
    assert (tracker.jaws(0).proxy_angle_rad, tracker.jaws(0).commanded_angle_rad) == (0.7, 0.4)
    assert told[0].jaw_angle_rad == 0.4, "physics is told what the handle asks for"


@pytest.mark.parametrize("count", ["contacts", "holds"])
def test_a_hold_holds_back_as_a_contact_does_and_neither_holds_nothing(tracker: Tracked, count: str) -> None:
    for n, back_m in ((1, 2e-3), (0, 0.0)):
        reaction = ToolReaction(
            position_m=HIP, proxy_position_m=(HIP[0], HIP[1], HIP[2] + 2e-3), proxy_jaw_angle_rad=0.7, **{count: n}
        )
        tracker.take_reactions((reaction, ToolReaction()))
        tracker.take_hands(hands(HIP, OTHER))
        assert junctions(tracker)[0][2] - HIP[2] == pytest.approx(back_m, abs=1e-15)
        assert opening_rad(tracker, 0) == pytest.approx(0.7 if n else 0.4)


def test_when_physics_is_silent_nothing_holds_the_tools_back(tracker: Tracked) -> None:
    tracker.take_reactions((HELD_BACK, HELD_BACK))
    tracker.reactions.forget()
    tracker.take_hands(hands(HIP, OTHER))
    np.testing.assert_array_equal(junctions(tracker), [HIP, OTHER])
    assert [ToolReaction.from_row(row) for row in tracker.reactions.rows.tolist()] == [ToolReaction()] * 2
    assert opening_rad(tracker, 0) == pytest.approx(0.4)


def test_a_tool_that_has_gone_is_absent_and_one_that_comes_is_there(tracker: Tracked) -> None:
    assert tracker.present.tolist() == [False, False]
    for hips, present in (((HIP, OTHER), [True, True]), ((HIP,), [True, False]), ((), [False, False])):
        told = tracker.take_hands(hands(*hips))
        assert tracker.present.tolist() == present
        assert len(told) == len(hips)


def test_more_instruments_than_tools_are_left_out(tracker: Tracked) -> None:
    told = tracker.take_hands(hands(HIP, OTHER, (0.0, 0.0, 0.0)))
    assert len(told) == 2
    np.testing.assert_array_equal(junctions(tracker), [HIP, OTHER])
    tracker.take_reactions((ToolReaction(), ToolReaction(), HELD_BACK))
    tracker.take_hands(hands(HIP, OTHER, HIP))
    np.testing.assert_array_equal(junctions(tracker), [HIP, OTHER])


def test_nothing_is_known_of_a_tool_that_physics_no_longer_tells_of(tracker: Tracked) -> None:
    """Its hand may have gone far since: a force about where it was would be none of the tissue's."""
    tracker.take_reactions([HELD_BACK, HELD_BACK])
    tracker.take_reactions([HELD_BACK])
    assert tracker.reactions.rows[0, REACTION_CONTACTS] == 1.0
    np.testing.assert_array_equal(tracker.reactions.rows[1], ToolReaction().row())
    tracker.take_reactions([])
    np.testing.assert_array_equal(tracker.reactions.rows[0], ToolReaction().row())
