"""What a catheter and its introducer must survive: strokes, withdrawal, being pulled out, being swept aside."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from trocar.services.mechanics import scenarios
from trocar.services.mechanics.bodies.catheter import build_introducer, rod_supports
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.scenarios import PlayedScene, ToolMotion
from trocar.services.mechanics.scene import CatheterScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyBook

# Where the middle of the jaws is, in mm, at times in s: the catheter is grasped and carried to the mouth.
PICK = ((0.0, (72, 1.5, 12)), (0.25, (72, 1.5, 0)), (0.5, (72, 1.5, 0)), (0.8, (68, 0, 0)), (1.0, (66, 0, 0)))
INSERT = (*PICK, (1.9, (44.5, 0, 0)))
# 2 mu N of this grasp, mu = 0.5: N comes of 0.1 rad of a spring of 0.2 N m/rad, 11 mm beyond the hinge.
GRIP_N = 1.8
# At the hand it is more: jaws bear 0.6 N across themselves, and from the port to J it is 8 to 18 % less far.
FELT_N = 1.25 * GRIP_N
PEAK = 1.875  # of a least-jerk motion, over its mean speed


def strokes(length_mm, speed_m_s, count):
    """Back and forth from the end of the insertion, each way with this peak speed."""
    way_s = PEAK * 1e-3 * length_mm / speed_m_s
    return tuple((1.9 + k * way_s, (44.5 + (length_mm if k % 2 else 0), 0, 0)) for k in range(1, 2 * count + 1))


def hands(points, name, open_at=()):
    """The left hand through points; its jaws are open at the first two of them and at ``open_at``, else shut."""
    jaws = tuple(0.7 if k in (0, 1, *open_at) else 0.25 for k in range(len(points)))
    motion = ToolMotion(
        time_s=tuple(t for t, _ in points),
        grip_point_m=tuple(tuple(1e-3 * c for c in point) for _, point in points),
        jaw_angle_rad=jaws,
        roll_rad=(0.5 * math.pi,) * len(points),
    )
    whole = scenarios.insertion()
    return replace(whole, name=name, duration_s=points[-1][0] + 0.3, motions=(motion, whole.motions[1]))


@dataclass
class Course:
    """What happened, tick by tick."""

    simulation: Simulation
    book: EnergyBook | None = None
    force_n: list = field(default_factory=list)
    gripped_n: list = field(default_factory=list)
    penetration_m: list = field(default_factory=list)
    depth_m: list = field(default_factory=list)
    hub_m: list = field(default_factory=list)
    tip_m: list = field(default_factory=list)
    speed_m_s: list = field(default_factory=list)
    strain: list = field(default_factory=list)
    spent_j: list = field(default_factory=list)

    def gain(self):
        """Largest fall of what was put in and is not stored, over the largest energy put in."""
        spent_j = np.array(self.spent_j)
        return np.max(np.maximum.accumulate(spent_j) - spent_j) / self.book.flow.input_j


def gripped_n(simulation):
    """What jaws that hold the catheter bear by friction: across themselves they bear what comes."""
    rows = simulation.contacts
    grips = np.flatnonzero(rows.law[: rows.n_contacts] == number_of("grip"))
    return np.linalg.norm(np.einsum("gax,ga->x", rows.frame[grips, 1:], rows.force_n[grips, 1:]))


def largest_strain(catheter):
    """Of stretch, or of bending at the surface."""
    edges_m, length_m = np.diff(catheter.state.position_m, axis=0), catheter.properties.segment_length_m
    long_m = np.linalg.norm(edges_m, axis=1)
    turn_m = np.linalg.norm(np.diff(edges_m / long_m[:, None], axis=0), axis=1)
    return max(np.abs(long_m / length_m - 1.0).max(), catheter.radius_m * turn_m.max() / length_m)


def run(scenario: PlayedScene, duct, *, books=False):
    simulation, tools = Simulation(scenario.scene, duct), ToolInputs()
    scenario.write_inputs(0.0, tools)
    simulation.step(tools)
    course = Course(simulation, EnergyBook(simulation) if books else None)
    introducer = rod_supports(scenario.scene.catheter).introducer.springs()
    for tick in range(round(1000 * scenario.duration_s)):
        scenario.write_inputs(1e-3 * tick, tools)
        (course.book or simulation).step(tools)
        if course.book is not None:
            course.spent_j.append(course.book.flow.input_j - course.book.flow.stored_j)
        rod = simulation.catheter.state
        course.force_n.append(simulation.tool_results.force_n.copy())
        course.gripped_n.append(gripped_n(simulation))
        course.penetration_m.append(simulation.max_penetration_m)
        course.depth_m.append(simulation.inserted_length_m)
        course.hub_m.append((rod.position_m[0] - introducer.entry) @ introducer.axis)
        course.tip_m.append((rod.position_m[-1] - introducer.entry) @ introducer.axis - introducer.length)
        course.speed_m_s.append(np.abs(rod.velocity_m_s).max())
        course.strain.append(largest_strain(simulation.catheter))
    return course


def largest_force_n(course):
    return np.linalg.norm(course.force_n, axis=2).max()


@pytest.mark.parametrize("speed_m_s", [pytest.param(0.1, marks=pytest.mark.long), 0.3])
def test_strokes_of_11_mm_stay_in_the_lumen_and_in_the_books(insertion_duct, speed_m_s):
    course = run(hands((*INSERT, *strokes(11.0, speed_m_s, 3)), "strokes"), insertion_duct, books=True)
    assert max(course.penetration_m) < 0.1e-3
    assert largest_force_n(course) < 0.3
    assert np.linalg.norm(np.diff(course.force_n, axis=0), axis=2).max() < 0.3
    depth = np.array(course.depth_m)[1900:]
    assert depth.min() < 12e-3
    assert depth[-1] > 20e-3
    flow = course.book.flow
    assert abs(flow.imbalance_j) < 0.01 * flow.input_j
    assert flow.rod_j > 0.0


@pytest.mark.long
def test_a_catheter_withdrawn_at_once_stays_in_its_introducer_and_goes_in_again(insertion_duct):
    """The hand goes 80 mm beyond where the catheter's end stops, at 0.5 m/s, and comes back; the grip slips instead.

    So it is further from the tip then, and takes the catheter again where it was. Nothing comes of what has slipped.
    How much slips is what the catheter, bent back round the introducer's edge, does not give: a stronger grip bends it
    tighter. The tip comes back by so much less, and goes in by so much less.
    """
    out = ((2.6, (72, 0, 0)), (2.9, (150, 0, 0)), (3.2, (150, 0, 0)), (3.7, (90, 0, 0)))
    again = ((3.9, (90, 0, 0)), (4.1, (90, 1.5, 12)), *((4.4 + t, at) for t, at in INSERT))
    first_open = len(INSERT) + len(out)
    points = (*INSERT, *out, *again)
    course = run(hands(points, "withdrawal", range(first_open, first_open + 4)), insertion_duct, books=True)
    assert course.gain() < 1e-3
    withdrawn = np.array(course.tip_m)[2900:3200]
    assert 4e-3 < withdrawn.min() < 8e-3
    assert min(course.depth_m[2600:3200]) == 0.0
    tip_m = np.array(course.tip_m)
    nearer_m = tip_m[450] - tip_m[4850]  # of two grasps, both with the hand 72 mm from the mouth
    assert nearer_m > 1e-3
    assert course.depth_m[-1] == pytest.approx(course.depth_m[1900] - nearer_m, abs=0.1e-3)
    assert max(course.penetration_m) < 0.1e-3
    assert 0.99 * GRIP_N < max(course.gripped_n) < GRIP_N
    assert largest_force_n(course) < FELT_N
    assert max(course.speed_m_s) < 10.0


def test_a_catheter_that_is_pulled_on_stops_with_its_end_in_the_introducer(insertion_duct):
    """The hand takes it 120 mm away; 4 mm of it stay in the introducer's 25 mm, less what the stop gives."""
    away = ((1.4, (90, -60, 60)), (1.9, (70, -120, 70)), (2.3, (70, -120, 70)))
    course = run(hands((*PICK, *away), "pulled"), insertion_duct)
    assert 21e-3 < max(course.hub_m) < 22e-3
    assert 0.99 * GRIP_N < max(course.gripped_n) < GRIP_N
    assert largest_force_n(course) < FELT_N
    assert max(course.speed_m_s) < 10.0


@pytest.mark.long
def test_a_catheter_swept_round_behind_its_introducer_is_not_caught_by_it(insertion_duct):
    """The free end crosses the planes of the introducer 60 mm beside it; then the hand has its catheter as before."""
    round_it = (
        (2.6, (72, 0, 0)),
        (2.9, (72, 80, 0)),
        (3.2, (180, 40, 0)),
        (3.5, (180, -40, 0)),
        (3.8, (72, -80, 0)),
        (4.4, (72, 0, 0)),
    )
    course = run(hands((*INSERT, *round_it), "swept"), insertion_duct)
    assert 0.99 * GRIP_N < max(course.gripped_n) < GRIP_N
    assert largest_force_n(course) < FELT_N
    # It snaps over the jaw that it was wound round, no faster than its stretch lets it.
    catheter = course.simulation.scene.catheter
    assert max(course.speed_m_s) < max(course.strain) * math.sqrt(catheter.youngs_modulus_pa / catheter.density_kg_m3)
    assert -0.1 < min(course.hub_m) <= max(course.hub_m) < 23e-3


@pytest.mark.long
def test_a_catheter_bent_round_the_edge_of_its_introducer_by_a_grasp_that_never_slips_stays_calm(insertion_duct):
    """To its stop and 10 mm further, at more than 60 degrees to the axis.

    The coupling gives these 10 mm at 0.5 N/mm, 5 mm for what winds round a jaw (a quarter of its turn with the catheter
    on it, and its radius), and 1 mm for what the stop gives.
    """
    aside = (
        (2.6, (72, 0, 0)),
        (3.0, (100, 60, 20)),
        (3.4, (160, 60, 20)),
        (3.8, (160, -60, 20)),
        (4.4, (100, -60, 0)),
        (5.0, (72, 0, 0)),
    )
    scenario = hands((*INSERT, *aside), "edge")
    effects = {name: settings for name, settings in scenario.scene.effects.items() if name != "grasp_slip"}
    course = run(replace(scenario, scene=replace(scenario.scene, effects=effects)), insertion_duct)
    assert 2.0 < largest_force_n(course) < 8.0
    assert np.linalg.norm(np.diff(course.force_n, axis=0), axis=2).max() < 0.5
    assert max(course.speed_m_s) < 5.0
    assert max(course.hub_m) < 23e-3


def test_a_catheter_that_would_start_outside_its_introducer_is_refused():
    with pytest.raises(ValueError, match=r"introducer_to_tip_m: 0.1 m leaves .* 0.005 and 0.096 m"):
        build_introducer(CatheterScene(introducer_to_tip_m=0.1))
    with pytest.raises(ValueError, match=r"introducer_to_tip_m: 0.001 m"):
        build_introducer(CatheterScene(introducer_to_tip_m=1e-3))


def test_the_seal_keeps_a_catheter_that_points_down_where_it_was_left(insertion_duct):
    """Its weight pulls along the introducer: through a seal it creeps, without one it falls out to its stop."""
    moved = {}
    for seal_n in (0.0, 20e-3):
        scene = scenarios.insertion_scene()
        catheter = replace(scene.catheter, direction=(0.0, 0.0, -1.0), tip_position_m=(80e-3, 0.0, 0.0))
        scene = replace(scene, catheter=replace(catheter, introducer_seal_friction_n=seal_n))
        simulation, tools = Simulation(scene, insertion_duct), ToolInputs()
        tools.present[:] = False
        for _ in range(500):
            simulation.step(tools)
        moved[seal_n] = -simulation.catheter.state.position_m[-1, 2]
    assert moved[0.0] > 5e-3
    assert moved[20e-3] < 5e-6
