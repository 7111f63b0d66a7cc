"""A guide wire that is pushed and twisted from behind: it stays where friction holds it, and the books close."""

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.scene import CatheterSection, DriveScene, GuideWireScene, WireDriveScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.snapshot import Snapshot
from trocar.studies.energy_book import EnergyBook
from trocar.studies.stability.finely import contact_forces_n

LENGTH_M, BEHIND_M = 0.1, 1e-3


@pytest.fixture(scope="module")
def rested(small_scene, small_duct):
    """With a wire that is straight, at rest, and its state then."""
    simulation, inputs = with_wire(small_scene, small_duct, GuideWireScene(friction=0.3))
    for _ in range(1500):
        simulation.step(inputs)
    return simulation, inputs, Snapshot(simulation, (simulation.scene, small_duct, simulation.duct.reduced))


@pytest.fixture
def wired(rested):
    simulation, inputs, snapshot = rested
    snapshot.restore()
    return simulation, deepcopy(inputs)


def with_wire(small_scene, small_duct, wire):
    """A catheter whose last 30 mm are bent at rest, 20 mm out of its introducer, and a wire 10 mm out of it."""
    bend = CatheterSection(length_m=30e-3, rest_curvature_1_m=(40.0, 0.0, 0.0), steering_1_m_rad=(0.0, 60.0, 0.0))
    placed = replace(
        small_scene.catheter, n_segments=50, length_m=LENGTH_M, tip_position_m=(80e-3, 0.0, 0.0),
        introducer_to_tip_m=35e-3, introducer_length_m=LENGTH_M - 40e-3, sections=(bend,), internal_damping_s=2e-3,
        guide_wire=wire,
    )  # fmt: skip
    tools = (DriveScene(coupling_stiffness_n_m=2000.0), WireDriveScene())
    scene = replace(small_scene, catheter=placed, forceps=tools, effects={"twist": NoSettings()})
    simulation, inputs = Simulation(scene, small_duct), ToolInputs()
    inputs.position_m[0] = (80e-3 + LENGTH_M, 0.0, 0.0)
    inputs.position_m[1] = inputs.position_m[0] + (BEHIND_M, 0.0, 0.0)
    return simulation, inputs


def push(step, inputs, *, by_m=0.0, rolled_rad=0.0, ticks=400, rest=200):
    x_m, roll_rad = inputs.position_m[1, 0], inputs.roll_rad[1]
    for tick in range(ticks + rest):
        share = min((tick + 1) / ticks, 1.0)
        inputs.position_m[1, 0], inputs.roll_rad[1] = x_m - share * by_m, roll_rad + share * rolled_rad
        step(inputs)


def test_what_friction_holds_does_not_creep_and_what_slides_is_felt(wired):
    simulation, inputs = wired
    drive = simulation.wire_drive
    start, held_n = drive.motion.place[0], drive.motion.push_n
    push(simulation.step, inputs, by_m=20e-6, rest=800)  # both couplings give, one after the other
    assert drive.motion.place[0] == start
    assert drive.motion.push_n - held_n == pytest.approx(20e-6 / (1.0 / 500.0 + 1.0 / 2000.0), rel=0.05)
    assert simulation.tool_results.force_n[1, 0] == pytest.approx(drive.motion.push_n)  # outwards is along -x
    assert contact_forces_n(simulation) == pytest.approx(simulation.tool_results.force_n)  # a judge knows of it, too
    push(simulation.step, inputs, by_m=15e-3, rest=0)
    assert drive.motion.place[0] - start == pytest.approx(15e-3, abs=0.3e-3)
    assert drive.motion.push_n > 0.0
    here = drive.motion.place[0]
    push(simulation.step, inputs, ticks=50)
    stays = drive.motion.place[0]
    assert stays - here < 0.3e-3
    push(simulation.step, inputs, ticks=500)
    assert drive.motion.place[0] == stays
    position_m = simulation.catheter.state.position_m
    out_m = float(np.linalg.norm(np.diff(position_m[50:], axis=0), axis=1).sum())
    assert out_m == pytest.approx(stays, rel=1e-4)
    assert simulation.healed_states == 0


def test_the_books_close_while_the_wire_is_pushed_twisted_and_pulled_in(wired):
    simulation, inputs = wired
    book = EnergyBook(simulation)
    push(book.step, inputs, by_m=20e-3)
    push(book.step, inputs, by_m=2e-3, rolled_rad=2.0)
    push(book.step, inputs, by_m=-15e-3)
    assert book.flow.input_j > 1e-5
    assert simulation.wire_drive.motion.friction_j > 0.1 * book.flow.input_j
    assert abs(book.flow.imbalance_j) < 1e-4 * book.flow.input_j


def test_the_books_close_while_both_drives_go_in_jerks(wired):
    """The wire's drive holds on to where the catheter's end was as a step began: what that takes is told."""
    simulation, inputs = wired
    book, moved_j = EnergyBook(simulation), 0.0
    for tick in range(200):
        inputs.position_m[:, 0] -= 0.1e-3 * (tick % 2)
        inputs.position_m[1, 0] -= 0.05e-3
        book.step(inputs)
        moved_j = max(moved_j, abs(book.flow.input_j), abs(book.flow.stored_j))
        assert abs(book.flow.imbalance_j) < 1e-4 * moved_j + 1e-9
    assert simulation.wire_drive.motion.push_n > 0.0


def test_a_wire_that_is_let_go_of_stays_where_its_valve_holds_it(wired):
    simulation, inputs = wired
    book = EnergyBook(simulation)
    push(book.step, inputs, by_m=15e-3, rolled_rad=1.0, rest=0)
    inputs.present[1] = False
    book.step(inputs)
    put_j, motion = book.flow.input_j, simulation.wire_drive.motion
    for _ in range(300):
        book.step(inputs)
    then = simulation.wire_drive.motion
    assert (then.place[0], then.twisted_rad, then.speed_m_s) == (motion.place[0], motion.twisted_rad, 0.0)
    assert abs(book.flow.input_j - put_j) < 1e-3 * put_j
    assert abs(book.flow.imbalance_j) < 1e-4 * put_j


def test_the_books_close_from_the_start_on_with_a_bent_wire_that_is_hardly_rubbed(small_scene, small_duct):
    """What steps miss of the bend that comes out in them, and of the turn to where it rests, is told."""
    bend = CatheterSection(length_m=14e-3, youngs_modulus_pa=1.2e9, rest_curvature_1_m=(0.0, 80.0, 0.0))
    simulation, inputs = with_wire(small_scene, small_duct, GuideWireScene(friction=0.01, sections=(bend,)))
    book = EnergyBook(simulation)
    push(book.step, inputs, by_m=12e-3)
    push(book.step, inputs, rolled_rad=3.0)
    push(book.step, inputs, by_m=-12e-3)
    moved_j = max(abs(book.flow.input_j), abs(book.flow.stored_j))
    assert abs(book.flow.imbalance_j) < 0.01 * moved_j
    assert book.flow.numerical_j > 0.0


def test_the_books_close_while_a_catheter_is_steered_around_its_wire(wired):
    simulation, inputs = wired
    book = EnergyBook(simulation)
    for handle_rad in [*np.linspace(0.0, 1.0, 300), *np.full(200, 1.0)]:
        inputs.jaw_angle_rad[0] = handle_rad
        book.step(inputs)
    assert book.flow.input_j > 1e-4
    assert abs(book.flow.imbalance_j) < 0.01 * book.flow.input_j


def lengths(simulation):
    """How far the wire is out, by the particles; and in all that tells where it is."""
    out_m = float(np.linalg.norm(np.diff(simulation.catheter.state.position_m[50:], axis=0), axis=1).sum())
    wire = simulation.catheter.wire
    return out_m, [simulation.wire_drive.motion.place[0], wire.place[0], float(wire.model.rest_length[50:].sum())]


def test_a_step_that_is_taken_again_begins_with_the_wire_where_it_was(wired, monkeypatch):
    simulation, inputs = wired
    push(simulation.step, inputs, by_m=10e-3, rest=0)
    rod, before, is_detected = simulation.catheter.wire.model, [], simulation.splitter.is_detected
    arrays = [rod.rest_length, rod.mass, rod.drag, rod.rest_rotation, rod.joint_stiffness, rod.torsion]
    inputs.position_m[1, 0] -= 25e-6
    inputs.roll_rad[1] += 0.1
    start = simulation.wire_drive.motion, [array.copy() for array in arrays]
    begin = simulation._start.restore

    def restore():
        assert simulation.wire_drive.motion != start[0]
        begin()
        before.append(simulation.wire_drive.motion == start[0])
        before.extend(bool((now == then).all()) for now, then in zip(arrays, start[1], strict=True))

    def is_detected_or_new():
        simulation.splitter.detected_share = 0.25  # less than half: the step is taken again, in halves
        return bool(before) and is_detected()

    monkeypatch.setattr(simulation._start, "restore", restore)
    monkeypatch.setattr(simulation.splitter, "is_detected", is_detected_or_new)
    simulation.step(inputs)
    assert before == [True] * (1 + len(arrays))


def test_a_heal_takes_the_wire_back_with_the_particles(wired):
    simulation, inputs = wired
    push(simulation.step, inputs, by_m=10e-3, rolled_rad=1.0, rest=0)
    newest_m, drive = simulation.wire_drive.motion.place[0], simulation.wire_drive

    def spoil(dt_s):
        simulation.watcher = None
        simulation.catheter.state.position_m[-1, 2] = np.nan

    simulation.watcher = SimpleNamespace(begin=lambda: None, end=spoil)
    for _ in range(2):  # it is spoilt at the end of a step, and healed at the start of the next
        simulation.step(inputs)
    assert simulation.healed_states == 1
    out_m, told_m = lengths(simulation)
    assert out_m == pytest.approx(newest_m, abs=1e-6)
    np.testing.assert_allclose(told_m, out_m, rtol=1e-4)
    assert drive.motion.speed_m_s == drive.motion.push_n == drive.motion.torque_nm == 0.0
    inputs.position_m[:] = simulation.tools.hand[:, :3]  # or the hands would push on to where they were
    for _ in range(100):
        simulation.step(inputs)
    assert lengths(simulation)[0] == pytest.approx(out_m, abs=1e-4)
    assert abs(drive.motion.push_n) < 0.05
    assert simulation.healed_states == 1
