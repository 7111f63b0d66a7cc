"""Whatever a scene may name can be compiled before the loop begins."""

from __future__ import annotations

import pytest

from services.cache_directory import cache_directory
from services.mechanics.effects import EFFECTS, go_together
from services.physics.warm_up import warm_up
from services.scenes import load_duct, load_scene
from tests.physics.conftest import SMALL

pytestmark = pytest.mark.timeout(600)  # on a machine that has compiled nothing yet


@pytest.mark.parametrize("small", ["nonlinear_membrane.n_coordinates=2", "softening.n_squeezes=2"])
def test_a_scene_with_every_effect_warms_up(small: str) -> None:
    """Before collision detection is compiled there is none: no effect may insist on it."""
    names = [name for name in EFFECTS if go_together(name, small.partition(".")[0])]
    scene = load_scene(SMALL, [*(f"effects.{name}={{}}" for name in names), f"effects.{small}"])
    assert len(scene.effects) == len(EFFECTS) - 1
    warm_up(scene, load_duct(scene, cache_directory(), lambda stage, fraction: None))
