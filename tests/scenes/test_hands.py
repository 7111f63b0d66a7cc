"""Simulated hands find out from a scene's geometry what to do, wherever its mouth is."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.bodies.forceps.kinematics import tool_frame
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, QualityLevel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import STROKE_M, hands_of, roll_across, with_strokes

ANATOMY = Path(__file__).parents[2].parent / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"


def played(scene, cache):
    """Return a simulation after its hands have done what they do, and the largest force on a tool."""
    duct = load_duct(scene, cache, lambda stage, fraction: None)
    simulation, tools, largest_n = Simulation(scene, duct), ToolInputs(), 0.0
    hands = hands_of(simulation.scene, duct.mesh)
    for tick in range(round(1000 * hands.duration_s)):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        largest_n = max(largest_n, float(np.linalg.norm(simulation.tool_results.force_n, axis=1).max()))
    return simulation, largest_n


def displaced_m(simulation):
    """Return how far the wall is at most from where it is at rest."""
    moved_m = simulation.duct.surface_m() - simulation.duct.reduced.mesh.vertices_m
    return float(np.linalg.norm(moved_m, axis=1).max())


def test_the_mouth_of_a_tube_is_at_its_end_and_the_way_in_is_its_axis():
    mouth = mouth_opening(scene_mesh(DuctScene(length_m=30e-3, radius_m=3e-3, n_around=16, n_along=20)))
    assert mouth.centre_m == pytest.approx([30e-3, 0.0, 0.0], abs=1e-12)
    assert mouth.inward == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)
    assert mouth.radius_m == pytest.approx(3e-3)


@pytest.mark.parametrize("curvature_1_m", [10.0, -15.0])
def test_the_way_into_a_bent_duct_is_along_its_end(curvature_1_m):
    duct = DuctScene(curvature_1_m=curvature_1_m, cut_angle_rad=0.3)
    mouth = mouth_opening(scene_mesh(duct))
    # The axis at the mouth's end, and where it is 2.75 radii earlier: the chord between them.
    angle = curvature_1_m * (duct.length_m - 0.5 * 2.75 * duct.radius_m)
    assert mouth.inward @ np.array([-math.cos(angle), -math.sin(angle), 0.0]) > math.cos(math.radians(6.0))


def test_jaws_close_across_what_they_shall_hold():
    random = np.random.default_rng(3)
    for _ in range(20):
        forceps = replace(insertion_scene().forceps[0], port_position_m=tuple(random.normal(size=3) * 0.1))
        point, along = random.normal(size=3) * 0.02, random.normal(size=3)
        frame = np.empty((3, 3))
        tool_frame(point, np.array(forceps.port_position_m), roll_across(forceps, point, along), frame)
        assert frame[0] @ along == pytest.approx(0.0, abs=1e-9)


def test_the_catheter_is_inserted_wherever_the_mouth_looks(own_cache):
    scene = insertion_scene()
    bent = replace(scene.duct, curvature_1_m=12.0, n_modes=30, n_around=16, n_along=20)
    catheter = replace(scene.catheter, before_mouth_m=6e-3, introducer_length_m=20e-3)
    simulation, largest_n = played(replace(scene, duct=bent, catheter=catheter), own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert largest_n < 0.3


def test_nothing_is_dropped_or_put_back_in_the_default_scene_on_its_own_mesh(own_cache):
    """Its mesh is four times as fine as those of most tests: 111,000 entries of lists were dropped in five seconds."""
    simulation, largest_n = played(load_scene("default"), own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert simulation.dropped_contacts == (0, 0, 0)
    assert simulation.healed_states == 0
    assert largest_n < 0.3


def test_a_pinch_presses_the_duct_together_and_touches_nothing_else(own_cache):
    scene = replace(insertion_scene(), hands="pinch")
    simulation, largest_n = played(replace(scene, duct=replace(scene.duct, n_modes=30)), own_cache)
    assert 0.01 < largest_n < 1.0
    assert displaced_m(simulation) > 1e-3
    assert not simulation.tools.present[0]


@pytest.mark.parametrize("tools", by_day([slice(0, 2)], [slice(1, 2)]), ids=["beside a forceps", "alone"])
def test_a_probe_presses_the_duct_from_outside(own_cache, tools):
    scene = load_scene("probe", SMALLER)
    simulation, largest_n = played(replace(scene, forceps=scene.forceps[tools]), own_cache)
    assert 3e-3 < largest_n < 0.1
    assert displaced_m(simulation) > 1e-3


def test_shut_jaws_press_as_a_probe_does(own_cache):
    scene = load_scene("probe", [*SMALLER, "forceps=[{port_position_m: [0.01, 0.07, 0.11]}]"])
    assert played(scene, own_cache)[1] > 3e-3


def test_a_hand_that_has_no_jaws_to_steady_the_duct_stays_away(tmp_path):
    probe = load_scene("probe").forceps[1]
    scene = replace(load_scene("insertion", SMALLER), forceps=(load_scene("insertion").forceps[0], probe))
    assert hands_of(scene, scene_mesh(scene.duct)).motions[1] is None


def test_no_hands_are_there_where_none_are_wanted(tmp_path):
    scene = replace(insertion_scene(), hands="none")
    hands = hands_of(scene, scene_mesh(scene.duct))
    tools = ToolInputs()
    hands.write_inputs(0.5, tools)
    assert not tools.present.any()


def test_in_a_scanned_vessel_the_catheter_finds_the_mouth_and_goes_in(own_cache):
    if not ANATOMY.exists():
        pytest.skip(f"needs the scan {ANATOMY.name}, which is not part of the repository")
    scene = load_scene("anatomy", [f"duct.mesh_file={ANATOMY}"])
    simulation, largest_n = played(scene, own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert largest_n < 0.3


def write_stl(mesh, path):
    """Write a surface in mm, turned and moved as a scanner's axes might have it."""
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    corners = (1e3 * mesh.vertices_m @ turn.T + (120.0, -40.0, 15.0))[mesh.triangles]
    facets = (
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*at) for at in face)
        + "endloop\nendfacet\n"
        for face in corners
    )
    path.write_text("solid duct\n" + "".join(facets) + "endsolid duct\n")


def test_in_a_surface_from_any_file_the_catheter_finds_the_mouth_and_goes_in(own_cache, tmp_path):
    pytest.importorskip("trimesh", reason="needs the mesh packages")
    bent = DuctScene(radius_m=6e-3, length_m=42e-3, n_around=24, n_along=34, taper=0.2, curvature_1_m=6.0)
    write_stl(scene_mesh(bent), tmp_path / "bent.stl")
    scene = load_scene("anatomy", [f"duct.mesh_file={tmp_path / 'bent.stl'}", "duct.n_modes=30"])
    simulation, largest_n = played(scene, own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert largest_n < 0.3


SMALLER = ["duct.n_around=16", "duct.n_along=20", "duct.n_modes=30"]


#: By day `test_the_papers_scene_runs` inserts as far in the scene of the paper.
@pytest.mark.parametrize(
    "name", by_day(["everything"], ["paper", "default", "insertion", "narrow", "stone", "stiff-wall"])
)
def test_scenes_for_an_insertion_end_with_the_catheter_in_the_duct(name, own_cache):
    simulation, largest_n = played(load_scene(name, SMALLER), own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert largest_n < (0.3 if name != "paper" else 2.0)


def test_through_a_cut_the_catheter_goes_in_and_on_along_the_duct(own_cache):
    simulation, largest_n = played(load_scene("cholangiography"), own_cache)
    assert largest_n < 0.5
    assert simulation.entered_by == "incision"
    assert simulation.inserted_length_m > 12e-3
    tip, before = simulation.catheter.state.position_m[[-1, -4]]
    assert (tip - before)[0] < -0.9 * np.linalg.norm(tip - before)  # towards the common duct


def test_a_rung_of_fewer_particles_that_touch_kicks_no_hand_and_inserts_as_far(own_cache):
    levels = QualityLevel(), QualityLevel(name="half", iterations=15)
    scene = replace(load_scene("narrow", SMALLER), quality=levels)
    duct = load_duct(scene, own_cache, lambda *_: None)
    simulation, tools, steps_n = Simulation(scene, duct), ToolInputs(), []
    hands, before_n = hands_of(simulation.scene, duct.mesh), np.zeros((2, 3))
    for tick in range(round(1000 * hands.duration_s)):
        if tick % 50 == 0:
            simulation.set_quality(tick // 50 % 2)
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        steps_n.append(np.linalg.norm(simulation.tool_results.force_n - before_n, axis=1).max())
        before_n = simulation.tool_results.force_n.copy()
    assert max(steps_n[50::50]) < 0.2  # what the rig lets the force at a hand change in a millisecond
    assert simulation.inserted_length_m > 15e-3


STEADYING = ["default", "narrow", "stone", "stiff-wall", "everything"]


@pytest.mark.parametrize("name", STEADYING)
def test_the_jaws_that_steady_a_duct_touch_it_within_the_angle_of_friction(name):
    scene = load_scene(name)
    mesh = scene_mesh(scene.duct)
    hand = hands_of(place_catheter(scene, mesh), mesh).motions[1]
    # Both jaws lie on the duct before they close further, and where the hand starts they are 1 mm away from it.
    half_m = hand.grip_offset_m * math.sin(0.5 * hand.jaw_angle_rad[0]) - 1e-3
    assert 1.05 * half_m / hand.grip_offset_m < math.sin(math.atan(scene.effects["friction"].tool_mu_kinetic))
    assert hand.grip_offset_m < scene.forceps[1].jaw_length_m - 2e-3


def test_jaws_that_are_too_short_take_the_duct_near_their_tips():
    scene = load_scene("default", ["forceps.1.jaw_length_m=0.018"])
    mesh = scene_mesh(scene.duct)
    assert hands_of(place_catheter(scene, mesh), mesh).motions[1].grip_offset_m == pytest.approx(15e-3)


def test_the_duct_that_is_steadied_is_not_pushed_out_of_the_jaws(own_cache):
    """With jaws of 15 mm it slipped: the hand then felt 9.7 mN of the 20 that its jaws were pressed apart with."""
    scene = load_scene("default", SMALLER)
    simulation, _ = played(scene, own_cache)
    pressed_n = simulation.tool_results.grasp_torque_nm[1] / scene.forceps[1].jaw_length_m
    assert pressed_n > 30e-3
    assert np.linalg.norm(simulation.tool_results.force_n[1]) < 0.1 * pressed_n


def test_the_stone_is_pushed_further_in(own_cache):
    scene = load_scene("stone", SMALLER)
    simulation, _ = played(scene, own_cache)
    (start,) = scene.effects["gallstones"].position_m
    assert simulation.effects["gallstones"].position_m[0, 0] < start[0] - 3e-3


def test_the_catheter_is_drawn_back_and_pushed_in_again(own_cache):
    scene = load_scene("insertion", SMALLER)
    duct = load_duct(scene, own_cache, lambda *_: None)
    simulation, tools, depths_m = Simulation(scene, duct), ToolInputs(), []
    hands = with_strokes(hands_of(simulation.scene, duct.mesh), 1)
    for tick in range(round(1000 * hands.duration_s)):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        depths_m.append(simulation.inserted_length_m)
    pushed, drawn, again = depths_m[1900], depths_m[2750], depths_m[-1]
    assert pushed - drawn == pytest.approx(STROKE_M, rel=0.2)
    assert again == pytest.approx(pushed, abs=0.5e-3)


def test_a_pinch_is_let_go_and_made_again():
    scene = load_scene("pinch", SMALLER)
    hand = with_strokes(hands_of(scene, scene_mesh(scene.duct)), 1).motions[1]
    assert hand.jaw_angle_rad[-4:] == pytest.approx(np.take(hand.jaw_angle_rad, [2, 1, 1, 2]))


@pytest.mark.parametrize(
    ("overrides", "depth_m"),
    [
        (["duct.length_m=0.2", "duct.n_along=20"], (9e-3, 15e-3)),  # rows 10 mm apart
        (["duct.n_along=5", "duct.length_m=0.045"], (9e-3, 18e-3)),  # 9 mm apart
        (["duct.length_m=0.0095"], (7e-3, 9.5e-3)),  # ends before
    ],
)
def test_a_coarse_or_short_duct_is_held_where_it_has_vertices(overrides, depth_m):
    scene = load_scene("pinch", ["duct.n_around=20", "duct.n_along=26", *overrides, "duct.curvature_1_m=0.0"])
    mesh = scene_mesh(scene.duct)
    mouth, hand = mouth_opening(mesh), hands_of(scene, mesh).motions[1]
    away = np.array(hand.grip_point_m[-1]) - mouth.centre_m
    depth = away @ mouth.inward
    assert depth_m[0] < depth < depth_m[1]
    assert np.linalg.norm(away - depth * mouth.inward) < 1e-4


def test_a_duct_alone_is_left_alone(own_cache):
    scene = load_scene("duct-only", SMALLER)
    duct = load_duct(scene, own_cache, lambda *_: None)
    assert scene.duct_alone
    assert hands_of(scene, duct.mesh).motions == (None, None)
    alone = DuctAlone(scene, duct)
    before = alone.duct.surface_m()
    for _ in range(20):
        alone.step()
    assert (alone.duct.surface_m() == before).all()


def test_one_hand_alone_inserts_the_catheter(own_cache):
    scene = load_scene("insertion", SMALLER)
    simulation, _ = played(replace(scene, forceps=scene.forceps[:1]), own_cache)
    assert simulation.inserted_length_m > 15e-3
    assert not simulation.tools.present[1]


def test_one_hand_alone_pinches(own_cache):
    scene = load_scene("pinch", SMALLER)
    simulation, largest_n = played(replace(scene, forceps=scene.forceps[1:]), own_cache)
    # Where friction stops these jaws, and with it the force at their hinge, hangs on the last digits of the compliance;
    # how far they press the wall together does not.
    assert 0.01 < largest_n < 1.0
    assert displaced_m(simulation) > 1e-3
    assert not simulation.tools.present[1]
