"""Sections of a catheter: beams of several stiffnesses, and bent at rest, against closed forms at any mesh."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.bodies.catheter import CatheterBody, round_tube
from trocar.services.mechanics.effects.twist import Twist
from trocar.services.mechanics.scene import CatheterScene, CatheterSection, SceneModel
from trocar.services.mechanics.simulation.scene_catheter import scene_rod
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import build_scene
from trocar.services.scenes.bends import MOST_TURN_RAD

LENGTH_M = 0.12
HELD = CatheterScene(
    n_segments=60,
    length_m=LENGTH_M,
    anchor="clamped",
    internal_damping_s=5e-3,
    tip_position_m=(LENGTH_M, 0.0, 0.0),
    direction=(1.0, 0.0, 0.0),
)
SLOW_S = 1.0  # a step so long that inertia is negligible


def rod_of(scene):
    return scene_rod(SceneModel(catheter=scene), (Twist(None, SceneModel(catheter=scene)),))


def body_of(scene):
    return CatheterBody(scene, rod_of(scene))


def rest(body, load_n=(0.0, 0.0, 0.0)):
    """Bring a catheter to rest under a load at its tip, and return its particles' positions."""
    load, state = np.zeros_like(body.state.position_m), body.state
    load[-1] = load_n
    for _ in range(1000):
        before_m = state.position_m.copy()
        body.integrator.predict(state, load, SLOW_S)
        state.halt()
        if np.abs(state.position_m - before_m).max() < 1e-9:
            return state.position_m
    raise AssertionError("it does not come to rest")


def sections(n_most=4, bent=True):
    """Draw a scene of up to so many sections with any lengths, and any number of segments that their bends allow."""

    @st.composite
    def draw_scene(draw):
        n_segments, count = draw(st.integers(20, 200)), draw(st.integers(1, n_most))
        sharpest = MOST_TURN_RAD * n_segments / LENGTH_M if bent else 0.0
        listed = tuple(
            CatheterSection(
                length_m=draw(st.floats(1e-3, 0.9 * LENGTH_M / count)),
                youngs_modulus_pa=draw(st.floats(4e6, 70e6)),
                rest_curvature_1_m=(draw(st.floats(0.0, min(60.0, 0.9 * sharpest))), 0.0, 0.0),
            )
            for _ in range(count)
        )
        return replace(HELD, n_segments=n_segments, sections=listed)

    return draw_scene()


def spans(scene):
    """Pieces of a catheter from its tip on: (where it begins and ends from the tip, modulus, curvature)."""
    ends_m = np.cumsum([0.0, *(each.length_m for each in scene.sections)])
    yield from (
        (start_m, end_m, each.youngs_modulus_pa, each.rest_curvature_1_m[0])
        for (start_m, end_m), each in zip(pairwise(ends_m), scene.sections, strict=True)
    )
    yield ends_m[-1], scene.length_m, scene.youngs_modulus_pa, 0.0


def arcs_end_m(scene):
    """Where arcs joined to a straight piece end: (along it, aside)."""
    along_m = aside_m = turned_rad = 0.0
    for start_m, end_m, _, curvature_1_m in reversed(list(spans(scene))):
        turn_rad = curvature_1_m * (end_m - start_m)
        chord_m = (end_m - start_m) * np.sinc(turn_rad / (2.0 * np.pi))
        along_m += chord_m * np.cos(turned_rad + 0.5 * turn_rad)
        aside_m += chord_m * np.sin(turned_rad + 0.5 * turn_rad)
        turned_rad += turn_rad
    return np.array([along_m, aside_m])


@given(scene=sections())
def test_compliance_and_rest_turn_are_the_integrals_over_the_sections(scene):
    """Their sums over the rod and their first moments about the tip, to rounding, whatever the number of segments."""
    rod = rod_of(scene)
    segment_m, inertia_m4 = rod.segment_length_m, round_tube(scene).second_moment_m4()
    joints_m = segment_m * np.arange(1, scene.n_segments)[::-1]
    turns_rad = segment_m * rod.rest_curvature_1_m[:, 0] if rod.rest_curvature_1_m is not None else 0.0 * joints_m
    wall = 0.5 * segment_m / rod.per_end("bending_stiffness_n_m2")[0, 0]
    compliance = 1.0 / rod.joint_stiffness_n_m()
    exact = [0.0] * 4
    for start_m, end_m, modulus_pa, curvature_1_m in spans(scene):
        moment_m2, length_m = 0.5 * (end_m**2 - start_m**2), end_m - start_m
        exact[0] += moment_m2 * curvature_1_m
        exact[1] += moment_m2 / (modulus_pa * inertia_m4)
        exact[2] += length_m / modulus_pa
        exact[3] += length_m / (modulus_pa * inertia_m4)
    tip = 0.5 * segment_m / rod.per_end("bending_stiffness_n_m2")[-1, 1]
    torsion = 1.0 / rod.joint_stiffness_n_m("torsional_stiffness_n_m2")
    ends = rod.per_end("torsional_stiffness_n_m2")[[0, -1], [0, 1]]
    assert joints_m @ turns_rad == pytest.approx(exact[0], rel=1e-9, abs=1e-12)
    assert joints_m @ compliance + LENGTH_M * wall == pytest.approx(exact[1], rel=1e-9)
    area_m2 = round_tube(scene).area_m2()
    assert np.sum(segment_m / rod.axial_stiffness_n) * area_m2 == pytest.approx(exact[2], rel=1e-9)
    assert wall + compliance.sum() + tip == pytest.approx(exact[3], rel=1e-9)
    twist = torsion.sum() + np.sum(0.5 * segment_m / ends)
    assert twist == pytest.approx((1.0 + scene.poisson_ratio) * exact[3], rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    n_segments=st.integers(20, 200), length_m=st.floats(3e-3, 50e-3), turn_rad=st.floats(0.05, 1.5),
    modulus_pa=st.floats(5e6, 70e6),
)  # fmt: skip
def test_a_tip_that_is_bent_at_rest_reaches_as_far_aside_as_its_arc(n_segments, length_m, turn_rad, modulus_pa):
    curvature_1_m = min(turn_rad / length_m, 0.99 * MOST_TURN_RAD * n_segments / LENGTH_M)
    tip = CatheterSection(length_m=length_m, youngs_modulus_pa=modulus_pa, rest_curvature_1_m=(curvature_1_m, 0.0, 0.0))
    end_m = rest(body_of(replace(HELD, n_segments=n_segments, sections=(tip,))))[-1]
    exact_m = (1.0 - np.cos(curvature_1_m * length_m)) / curvature_1_m
    assert np.linalg.norm(end_m[1:]) == pytest.approx(exact_m, rel=0.01)


@pytest.mark.parametrize(("length_mm", "exact_mm"), [(15, 5.844), (16, 6.597), (17, 7.385)])
@pytest.mark.parametrize("n_segments", [20, 34, 48, 49, 96, 137])
def test_a_millimetre_more_of_a_bent_tip_is_a_millimetre_more(length_mm, exact_mm, n_segments):
    """The segments of 0.9 to 6 mm do not change what is reached by an arc of 55 1/m."""
    tip = CatheterSection(length_m=1e-3 * length_mm, youngs_modulus_pa=10e6, rest_curvature_1_m=(55.0, 0.0, 0.0))
    end_m = rest(body_of(replace(HELD, n_segments=n_segments, sections=(tip,))))[-1]
    assert 1e3 * np.linalg.norm(end_m[1:]) == pytest.approx(exact_mm, rel=0.01)


@settings(max_examples=30, deadline=None)
@given(scene=sections())
def test_arcs_in_a_row_end_where_they_end(scene):
    end_m = rest(body_of(scene))[-1]
    found_m = np.array([end_m[0], np.linalg.norm(end_m[1:])])
    bent_m = sum(each.length_m for each in scene.sections)
    exact_m = arcs_end_m(scene)
    assert np.linalg.norm(found_m - [exact_m[0], abs(exact_m[1])]) < 0.01 * bent_m


@settings(max_examples=30, deadline=None)
@given(scene=sections(bent=False))
def test_a_cantilever_of_several_stiffnesses_bends_as_its_pieces_do(scene):
    """Under a load P at the tip: each piece from a to b behind it adds P (b^3 - a^3) / 3 EI."""
    inertia_m4, load_n = round_tube(scene).second_moment_m4(), 1e-6
    end_m = rest(body_of(scene), (0.0, load_n, 0.0))[-1]
    exact_m = sum(
        load_n * (end**3 - start**3) / (3.0 * modulus * inertia_m4) for start, end, modulus, _ in spans(scene)
    )
    assert end_m[1] == pytest.approx(exact_m, rel=0.01)


def test_a_section_that_is_bent_at_rest_is_an_arc_and_the_rest_is_straight():
    section = CatheterSection(length_m=0.04, rest_curvature_1_m=(25.0, 0.0, 0.0))
    x = rest(body_of(replace(HELD, sections=(section,))))
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
        (
            "[{length_m: 0.01, rest_curvature_1_m: [0.0, 2000.0, 0.0]}]",
            "catheter.sections.0.rest_curvature_1_m: bends to a radius of 0.5 mm, below the catheter's own of 0.835 mm",
        ),
        (
            "[{length_m: 0.01}, {length_m: 0.01, rest_curvature_1_m: [300.0, 0.0, 0.0]}]",
            "catheter.n_segments: 50 are too few for catheter.sections.1.rest_curvature_1_m, which turns by 0.6 rad "
            "along one of 2 mm; 63 keep its shape to 1 %",
        ),
    ],
)
def test_sections_that_cannot_be_are_refused_in_one_sentence(sections, sentence):
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        build_scene(yaml.safe_load(f"catheter: {{sections: {sections}}}"), "scene.yaml")


def test_a_handle_or_a_wire_that_bends_below_its_radius_is_refused():
    steered = """{forceps: [{kind: drive, handle_max_angle_rad: 2.0}], hands: none, effects: {twist: {}},
        catheter: {sections: [{length_m: 0.01, steering_1_m_rad: [700.0, 0.0, 0.0]}]}}"""
    with pytest.raises(ConfigError, match=r"sections\.0\.steering_1_m_rad: bends to a radius of 0\.714 mm, below the"):
        build_scene(yaml.safe_load(steered), "scene.yaml")
    wired = """{forceps: [{kind: wire_drive}], hands: none, effects: {twist: {}},
        catheter: {guide_wire: {sections: [{length_m: 0.01, rest_curvature_1_m: [3000.0, 0.0, 0.0]}]}}}"""
    with pytest.raises(ConfigError, match=r"guide_wire\.sections\.0\.rest_curvature_1_m: .* below the wire's own of"):
        build_scene(yaml.safe_load(wired), "scene.yaml")
