"""Sections of a catheter: a beam of two stiffnesses, and one that is bent at rest, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.effects.twist import Twist
from trocar.services.mechanics.scene import CatheterScene, CatheterSection, SceneModel
from trocar.services.mechanics.simulation.scene_catheter import scene_rod
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import build_scene

HELD = CatheterScene(
    n_segments=60,
    length_m=0.12,
    anchor="clamped",
    internal_damping_s=5e-3,
    tip_position_m=(0.12, 0.0, 0.0),
    direction=(1.0, 0.0, 0.0),
)
SOFT = CatheterSection(length_m=0.04, youngs_modulus_pa=7e6)


def body_of(scene, effects=()):
    return CatheterBody(scene, scene_rod(SceneModel(catheter=scene), effects))


def rest(body, steps=6000):
    for _ in range(steps):
        body.predict(1e-3)
    assert np.abs(body.state.velocity_m_s).max() < 1e-6


def test_a_cantilever_of_two_stiffnesses_bends_as_its_pieces_do():
    """Under a load at the tip: P b^3 / 3 EI of the soft tip, and P (L^3 - b^3) / 3 EI of what is behind it."""
    body, load_n = body_of(replace(HELD, sections=(SOFT,))), 1e-5
    stiff = body.properties.bending_stiffness_n_m2
    assert stiff[0] == pytest.approx(10.0 * stiff[-1])
    body.external_force_n[-1, 1] = load_n
    rest(body)
    b_m, length_m = 0.04, 0.12
    expected_m = load_n / 3.0 * (b_m**3 / stiff[-1] + (length_m**3 - b_m**3) / stiff[0])
    assert body.state.position_m[-1, 1] == pytest.approx(expected_m, rel=5e-3)


def test_a_section_that_is_bent_at_rest_is_an_arc_and_the_rest_is_straight():
    section = CatheterSection(length_m=0.04, rest_curvature_1_m=(25.0, 0.0, 0.0))
    scene = replace(HELD, sections=(section,))
    body = body_of(scene, (Twist(None, SceneModel(catheter=scene)),))
    rest(body)
    x = body.state.position_m
    edges = np.diff(x, axis=0) / np.linalg.norm(np.diff(x, axis=0), axis=1)[:, None]
    angle = np.arccos(np.clip(np.sum(edges[1:] * edges[:-1], axis=1), -1.0, 1.0))
    assert angle[-18:].sum() / (18 * 2e-3) == pytest.approx(25.0, rel=1e-3)
    assert angle[:38].max() < 1e-5


@pytest.mark.parametrize(
    ("sections", "sentence"),
    [
        ("[{length_m: 0.2}]", "catheter.sections: are 0.2 m long together, the catheter 0.1 m"),
        ("[{length_m: -1.0}]", "catheter.sections.0.length_m: must be positive, is -1.0"),
        ("[{length_m: 0.01, steering_1_m_rad: [9.0, 0.0, 0.0]}]", "name the effect 'twist' too"),
        ("[{length_m: 0.01, youngs_modulus_pa: 0.0}]", "youngs_modulus_pa: must be positive, is 0.0"),
    ],
)
def test_sections_that_cannot_be_are_refused_in_one_sentence(sections, sentence):
    with pytest.raises(ConfigError, match=sentence.replace(".", r"\.")):
        build_scene(yaml.safe_load(f"catheter: {{sections: {sections}}}"), "scene.yaml")
