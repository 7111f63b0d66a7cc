import numpy as np
import pytest

from trocar.services.mechanics.bodies.forceps import (
    Grasp,
    JawState,
    ToolBody,
    contact_lever,
    jaw_angle_from_handle,
    tool_frame,
)
from trocar.services.mechanics.bodies.forceps import grasp as grasp_module
from trocar.services.mechanics.bodies.forceps.kinematics import tool_segments
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A, JAW_B, SHAFT, ContactPairs
from trocar.services.mechanics.scene import CatheterScene, ForcepsScene
from trocar.services.mechanics.scene.tools import ToolInputs

PORT = np.array([0.07, -0.06, 0.12])
JUNCTION = np.array([0.05, 0.01, 0.005])


def point_of(junction, angle, segment, local, roll=0.7):
    """A material point with coordinates (b, h, d) in the frame of its segment."""
    frame = np.zeros((3, 3))
    tool_frame(junction, PORT, roll, frame)
    half = {SHAFT: 0.0, JAW_A: 0.5, JAW_B: -0.5}[segment] * angle
    b = np.cos(half) * frame[0] - np.sin(half) * frame[2]
    d = np.sin(half) * frame[0] + np.cos(half) * frame[2]
    return junction + local @ np.array([b, frame[1], d])


@pytest.mark.parametrize("segment", [SHAFT, JAW_A, JAW_B])
def test_lever_is_the_derivative_of_the_pose(segment):
    local, angle, h = np.array([2e-3, 3e-3, 10e-3]), 0.5, 1e-6
    frame, lever = np.zeros((3, 3)), np.zeros((3, 4))
    length = tool_frame(JUNCTION, PORT, 0.7, frame)
    contact_lever(frame, length, segment, point_of(JUNCTION, angle, segment, local) - JUNCTION, lever)
    for column in range(4):
        step = h * np.eye(4)[column]
        ends = [point_of(JUNCTION + s * step[:3], angle + s * step[3], segment, local) for s in (1, -1)]
        assert np.allclose(lever[:, column], (ends[0] - ends[1]) / (2 * h), atol=1e-9)


def test_frame_is_orthonormal_and_starts_at_the_port():
    frame, segments = np.zeros((3, 3)), np.zeros((3, 2, 3))
    length = tool_frame(JUNCTION, PORT, 0.3, frame)
    tool_segments(JUNCTION, PORT, frame, 0.4, 15e-3, segments)
    assert np.allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    assert np.allclose(np.cross(frame[2], frame[0]), frame[1])
    assert length == pytest.approx(np.linalg.norm(JUNCTION - PORT))
    assert np.allclose(segments[SHAFT, 0], PORT)
    opening = segments[JAW_A, 1] - segments[JAW_B, 1]
    assert np.linalg.norm(opening) == pytest.approx(2 * 15e-3 * np.sin(0.2))
    assert np.linalg.norm(segments[JAW_A, 1] - JUNCTION) == pytest.approx(15e-3)


def test_jaws_shut_when_the_handle_is_shut_and_stop_at_their_stop():
    assert jaw_angle_from_handle(-0.1, 2.0, 1.0) == 0.0
    assert jaw_angle_from_handle(0.2, 2.0, 1.0) == pytest.approx(0.4)
    assert jaw_angle_from_handle(0.9, 2.0, 1.0) == 1.0


def tools_at(position):
    inputs = ToolInputs()
    inputs.position_m[:] = position
    return inputs


def test_coupling_is_a_spring_at_rest_and_gives_no_energy_back_that_was_not_stored():
    body = ToolBody((ForcepsScene(), ForcepsScene()))
    force = np.zeros((2, 4))
    force[0] = 0.3, -0.2, 0.5, 1e-3
    work, stored = 0.0, 0.0
    rng = np.random.default_rng(1)
    for _ in range(400):
        body.predict(tools_at(JUNCTION), 1e-3)
        before = body.stretch.copy()
        push = force * rng.uniform(0, 1)
        body.correct(push)
        work += np.sum(push * (body.stretch - before))
        stored = 0.5 * np.sum(body.stiffness * body.stretch**2)
        assert stored <= work + 1e-15
    for _ in range(200):
        body.predict(tools_at(JUNCTION), 1e-3)
        body.correct(force)
    assert np.allclose(body.stiffness * body.stretch, force, atol=1e-12)


def touching_pairs(kind, target_a, target_b):
    pairs = ContactPairs.zeros(capacity=4)
    for i, (segment, target) in enumerate(((JAW_A, target_a), (JAW_B, target_b))):
        pairs.tool[i], pairs.tool_segment[i], pairs.target_kind[i], pairs.target[i] = 0, segment, kind, target
        pairs.tool_parameter[i], pairs.target_weights[i] = 0.6, (0.5, 0.5, 0.0)
    pairs.count = 2
    return pairs


CATHETER = CatheterScene(length_m=80e-3, n_segments=40)


def new_grasp(small_duct):
    return Grasp(0, ForcepsScene(), small_duct.mesh, CATHETER)


def test_grasp_takes_hold_when_both_jaws_touch_and_the_handle_squeezes(small_duct):
    grasp = new_grasp(small_duct)
    pairs = touching_pairs(CATHETER_SEGMENT, 7, 7)
    assert grasp.update(pairs, JawState(0.40, 0.395)) == []  # touched, not squeezed: 1 mN m
    holds = grasp.update(pairs, JawState(0.40, 0.35))
    assert [h.target for h in holds] == [7, 7]
    arcs = [h.target + h.target_weights[1] for h in holds]
    assert np.mean(arcs) == pytest.approx(7.5)
    assert arcs[1] - arcs[0] == pytest.approx(0.5)  # a jaw's radius, 1 mm, in segments of 2 mm
    # 2 mu N / 2 holds, N = torque / lever = 0.2 * 0.05 / (0.6 * 15 mm)
    assert holds[0].limit_n == pytest.approx(0.5 * 0.2 * 0.05 / 9e-3)
    grasp.update(pairs, JawState(0.40, 0.30))
    assert holds[0].limit_n == pytest.approx(0.5 * 0.2 * 0.10 / 9e-3)


@pytest.mark.parametrize("segment", [0, 39])
@pytest.mark.parametrize("weight", [0.0, 0.1, 0.9, 1.0])
def test_what_is_held_at_an_end_of_the_catheter_is_there(small_duct, segment, weight):
    """Physics refuses tools that hold what is not there, and then stands still."""
    pairs = touching_pairs(CATHETER_SEGMENT, segment, segment)
    pairs.target_weights[:2] = (1.0 - weight, weight, 0.0)
    holds = new_grasp(small_duct).update(pairs, JawState(0.40, 0.35))
    assert len(holds) == 2
    for hold in holds:
        assert 0 <= hold.target < CATHETER.n_segments
        assert hold.target_weights.min() >= 0.0
        assert hold.target_weights.sum() == 1.0
        assert abs(hold.target + hold.target_weights[1] - segment - weight) <= 0.25 + 1e-12


def test_grasp_lets_go_when_the_handle_opens_past_where_it_closed(small_duct):
    grasp = new_grasp(small_duct)
    pairs = touching_pairs(CATHETER_SEGMENT, 7, 7)
    first = [h.hold_id for h in grasp.update(pairs, JawState(0.40, 0.35))]
    assert grasp.update(pairs, JawState(0.40, 0.42))[0].limit_n == 0.0
    assert not grasp.update(pairs, JawState(0.44, 0.44))
    again = [h.hold_id for h in grasp.update(pairs, JawState(0.40, 0.35))]
    assert not set(first) & set(again)


def test_holds_of_different_tools_never_share_a_number_however_many_tools_there_are(small_duct, monkeypatch):
    monkeypatch.setattr(grasp_module, "N_TOOLS", 3)
    numbers = []
    for tool in range(3):
        grasp = Grasp(tool, ForcepsScene(), small_duct.mesh, CATHETER)
        pairs = touching_pairs(CATHETER_SEGMENT, 7, 7)
        pairs.tool[:] = tool
        for _ in range(3):
            numbers += [hold.hold_id for hold in grasp.update(pairs, JawState(0.40, 0.35))]
            assert not grasp.update(pairs, JawState(0.44, 0.44))
    assert len(numbers) == 18
    assert len(set(numbers)) == 18


def test_one_jaw_alone_or_two_sides_of_the_tube_are_no_grasp(small_duct):
    grasp = new_grasp(small_duct)
    pairs = touching_pairs(CATHETER_SEGMENT, 7, 7)
    pairs.count = 1
    assert not grasp.update(pairs, JawState(0.40, 0.30))
    centres = small_duct.mesh.vertices_m[small_duct.mesh.triangles].mean(axis=1)
    ring = np.flatnonzero(np.abs(centres[:, 0] - 20e-3) < 2e-3)
    top, bottom = ring[np.argmax(centres[ring, 2])], ring[np.argmin(centres[ring, 2])]
    assert not grasp.update(touching_pairs(DUCT_TRIANGLE, top, bottom), JawState(0.40, 0.30))
    assert grasp.update(touching_pairs(DUCT_TRIANGLE, top, top), JawState(0.40, 0.30))
