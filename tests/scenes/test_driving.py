"""Hands that drive: what they find from the geometry brings the tip into the branch, a judge from outside says."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.by_day import by_day
from trocar.services.mechanics.bodies.sections import segment_radii
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene
from trocar.services.scenes.hands import hands_of
from trocar.services.scenes.ready import load_duct, load_surface


def deepest_m(simulation):
    """Of the catheter in the wall, as both are drawn: between points of all triangles near the axis and of the axis."""
    corners_m = simulation.duct.surface_m()[simulation.duct.reduced.mesh.triangles]
    x = simulation.catheter.state.position_m
    axis = (x[:-1, None] + np.linspace(0.0, 1.0, 6)[:, None] * np.diff(x, axis=0)[:, None]).reshape(-1, 3)
    longest_m = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max()
    corners_m = corners_m[cKDTree(axis).query(corners_m.mean(axis=1))[0] < longest_m + 3e-3]
    if not len(corners_m):
        return 0.0
    weights = np.array([(a, b, 8 - a - b) for a in range(9) for b in range(9 - a)]) / 8.0
    samples = np.einsum("wk,tkx->twx", weights, corners_m).reshape(-1, 3)
    radius_m = np.repeat(segment_radii(simulation.scene.catheter), 6)
    return float((radius_m - cKDTree(samples).query(axis)[0]).max()) + 0.5 * 1e-3


@pytest.mark.parametrize(
    ("name", "target"),
    by_day(
        [("bronchoscopy", "left_lower"), ("guide-wire", "subclavian")],
        [("bronchoscopy", "right_upper"), ("bronchoscopy", "right_lower"), ("bronchoscopy", "left_upper"),
         ("endovascular", "subclavian"), ("endovascular", "carotid"), ("guide-wire", "carotid")],
    ),
)  # fmt: skip
def test_hands_reach_the_target_and_never_cross_the_wall(name, target, own_cache):
    scene = load_scene(name, [f"target={target}"])
    duct = load_duct(scene, own_cache, lambda stage, fraction: None)
    ways = TubePaths(centrelines(duct.mesh))
    scenario = hands_of(place_catheter(scene, duct.mesh), duct.mesh)
    simulation, tools, deepest = Simulation(scene, duct), ToolInputs(), 0.0
    for tick in range(round(1e3 * scenario.duration_s)):
        scenario.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        if tick % 500 == 0:
            deepest = max(deepest, deepest_m(simulation))
    parted_m = max(ways.shared_m(target, other) for other in ways.path_m if other != target)
    assert simulation.entered_by == "mouth"
    for tip_m in simulation.catheter.state.position_m[[scene.catheter.n_segments, -1]]:  # and of what leads, the same
        assert ways.beyond(tip_m) == [target]
        assert ways.progress_m(tip_m, target) > parted_m + 2e-3
    assert deepest < 0.1e-3
    assert simulation.healed_states == 0
    assert not any(simulation.dropped_contacts)


@pytest.mark.parametrize(
    ("target", "turns"),
    [("subclavian", [0]), ("carotid", [1, 0]), ("brachiocephalic", [1, 1, 0]), ("trunk", [1, 1, 1])],
)
def test_a_tip_is_turned_to_the_vessel_in_which_it_ends_and_away_from_those_before(target, turns, own_cache):
    """All vessels and the arch lie in a plane, and the tip is bent in it from the beginning: half turns, no others."""
    scene = load_scene("endovascular", [f"target={target}"])
    mesh = load_surface(scene, own_cache)
    hand, _ = hands_of(place_catheter(scene, mesh), mesh).motions
    rolls = np.array(hand.roll_rad)
    still = np.array([math.dist(a, b) < 1e-9 for a, b in itertools.pairwise(hand.grip_point_m)])
    turned = rolls[1:][still][1:] / math.pi  # after the first pause
    np.testing.assert_allclose(turned, np.round(turned), atol=0.01)
    assert [round(each) % 2 for each in turned] == turns


def test_a_target_that_is_none_is_one_sentence(own_cache):
    scene = load_scene("endovascular", ["target=renal"])
    mesh = load_surface(scene, own_cache)
    with pytest.raises(ConfigError, match="target: the duct has no end 'renal'; it has: trunk, subclavian"):
        hands_of(place_catheter(scene, mesh), mesh)
