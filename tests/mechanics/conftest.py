"""A small duct, reduced once for all tests of the mechanics."""

from dataclasses import replace

import pytest

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import CatheterScene, DuctScene, ForcepsScene, SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.scenes import build_scene

SMALL_DUCT = DuctScene(n_around=12, n_along=14, n_modes=30, thickness_m=1e-3, youngs_modulus_pa=300e3, membrane="cst")


@pytest.fixture(scope="session")
def cache_dir(own_cache):
    return own_cache / "bases"


@pytest.fixture(scope="session")
def small_scene():
    """Catheter 15 mm in, both forceps above."""
    return SceneModel(
        duct=SMALL_DUCT,
        catheter=CatheterScene(n_segments=30, tip_position_m=(25e-3, 0.0, 0.0), introducer_to_tip_m=65e-3),
        forceps=(
            ForcepsScene(port_position_m=(20e-3, 0.0, 0.15)),
            ForcepsScene(port_position_m=(60e-3, 10e-3, 0.15)),
        ),
    )


@pytest.fixture(scope="session")
def small_duct(small_scene, cache_dir):
    return build_scene_duct(small_scene, cache_dir)


@pytest.fixture(scope="session")
def insertion_duct(cache_dir):
    return build_scene_duct(insertion_scene(), cache_dir)


@pytest.fixture
def with_effects(small_scene):
    """The small scene with effects whose settings are given, and checked, as in a scene file."""

    def build(**effects):
        return replace(small_scene, effects=build_scene({"effects": effects}, "scene.yaml").effects)

    return build
