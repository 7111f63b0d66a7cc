"""A hand at the neck: the mouth lies where the pull takes it, stays there, and a bent duct is straighter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene

STRAIGHT = DuctScene(n_around=16, n_along=20, n_modes=12, thickness_m=0.5e-3, youngs_modulus_pa=300e3)


def built(duct: DuctScene, cache_dir):
    return build_scene_duct(SceneModel(duct=duct, duct_alone=True), cache_dir)


def test_a_pull_stretches_a_straight_tube_as_a_bar(cache_dir) -> None:
    rest, pulled = (built(replace(STRAIGHT, traction_n=force_n), cache_dir) for force_n in (0.0, 0.1))
    moved_m = pulled.mesh.vertices_m - rest.mesh.vertices_m
    rim = rest.mesh.vertex_sets["mouth"]
    bar_m = 0.1 * 40e-3 / (300e3 * 2.0 * np.pi * 4e-3 * 0.5e-3)
    assert moved_m[rim, 0] == pytest.approx(bar_m, rel=0.03)
    assert moved_m[rim, 1:] == pytest.approx(0.0, abs=1e-3 * bar_m)
    assert moved_m[rest.mesh.vertex_sets["clamped"]] == pytest.approx(0.0, abs=1e-12)


def test_the_mouth_that_is_held_does_not_move(cache_dir) -> None:
    for force_n in (None, 0.0, 0.1):
        duct = built(replace(STRAIGHT, traction_n=force_n), cache_dir)
        moves = np.abs(duct.basis.Phi[duct.mesh.vertex_sets["mouth"]]).max()
        assert bool(moves > 0.0) is (force_n is None)


def test_a_bent_duct_is_straighter_when_it_is_pulled(cache_dir) -> None:
    bent = replace(STRAIGHT, curvature_1_m=15.0)
    turns = []
    for force_n in (0.0, 0.05):
        mesh = built(replace(bent, traction_n=force_n), cache_dir).mesh
        middle = mesh.vertices_m[np.abs(np.linalg.norm(mesh.vertices_m, axis=1) - 20e-3) < 2e-3].mean(axis=0)
        mouth = mouth_opening(mesh).centre_m
        ways = middle / np.linalg.norm(middle), (mouth - middle) / np.linalg.norm(mouth - middle)
        turns.append(np.arccos(ways[0] @ ways[1]))
    assert turns[1] < 0.97 * turns[0]


def test_a_simulation_runs_in_a_pulled_duct_and_stays_at_rest(cache_dir) -> None:
    scene = SceneModel(duct=replace(STRAIGHT, traction_n=0.05), forceps=())
    simulation = Simulation(scene, build_scene_duct(scene, cache_dir))
    hands = ToolInputs()
    hands.present[:] = False
    simulation.step(hands)
    assert np.abs(simulation.duct.state.qdot).max() < 1e-9


def test_a_pull_inwards_is_refused_by_its_key(tmp_path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("duct: {traction_n: -0.1}")
    with pytest.raises(ConfigError, match=r"duct\.traction_n"):
        load_scene(path)
