"""``auto`` for the cells of a duct: numbers that follow from the duct and the jaws, and where they came from."""

import numpy as np
import pytest

from trocar.services.mechanics.scene.mesh_cells import MOST_NODES_ALL_PAIRS, accurate_cells
from trocar.services.scenes import load_scene, scene_origins


def scene_of(tmp_path, text, overrides=()):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    return scene_origins(path, overrides)


def cells(scene):
    return scene.duct.n_around, scene.duct.n_along


def test_the_default_scene_leaves_its_cells_to_the_rule():
    assert cells(load_scene("default")) == accurate_cells(4e-3, 40e-3, 1e-3)
    wide = load_scene("default", ["duct.radius_m=6e-3", "duct.length_m=50e-3"])
    assert cells(wide) == accurate_cells(6e-3, 50e-3, 1e-3)
    assert cells(load_scene("default", ["duct.n_around=16"])) == (16, accurate_cells(4e-3, 40e-3, 1e-3)[1])


@pytest.mark.parametrize("key", ["curvature_1_m=5", "cut_angle_rad=0.3", "slit_length_m=8e-3"])
def test_a_duct_whose_parts_differ_has_no_more_nodes_than_all_pairs_are_held_of(key):
    around, along = cells(load_scene("default", [f"duct.{key}"]))
    assert around * (along + 1) <= MOST_NODES_ALL_PAIRS < np.prod(cells(load_scene("default")))


def test_cells_follow_from_the_narrowest_jaw_and_say_that_they_were_automatic(tmp_path):
    text = "duct: {n_around: auto, n_along: auto}\nforceps: [{jaw_radius_m: 2.0e-3}, {jaw_radius_m: 1.5e-3}]\n"
    scene, origins = scene_of(tmp_path, text)
    assert cells(scene) == accurate_cells(4e-3, 40e-3, 1.5e-3)
    assert origins["duct.n_along"] == f"auto in {tmp_path / 'a.yaml'}"


def test_one_number_may_be_said_and_an_override_may_ask_for_the_rule(tmp_path):
    scene, _ = scene_of(tmp_path, "duct: {n_around: 12, n_along: 9}\n", ["duct.n_along=auto"])
    assert cells(scene) == (12, accurate_cells(4e-3, 40e-3, 1e-3)[1])
