"""A guide wire in its catheter as one rod, against closed forms: stiffness, rest shape, the capstan, and torque."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ellipk

from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.guide_wire import GuideWire, frame_of, wire_tube
from trocar.services.mechanics.effects import build_effects
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.rod import ImplicitIntegrator, Supports, straight_rod
from trocar.services.mechanics.rod.guide_wire import insertion_forces
from trocar.services.mechanics.rod.material_frame import initial_frame
from trocar.services.mechanics.scene import CatheterScene, CatheterSection, GuideWireScene, SceneModel, WireDriveScene
from trocar.services.mechanics.simulation.scene_catheter import scene_rod

N, LENGTH_M, OUT_M, LOAD_N = 60, 0.12, 20e-3, 5e-4
BENT = CatheterSection(length_m=50e-3, rest_curvature_1_m=(20.0, 0.0, 0.0))
WIRE = GuideWireScene(out_m=OUT_M, friction=0.3)
CATHETER = CatheterScene(
    n_segments=N, length_m=LENGTH_M, introducer_to_tip_m=60e-3, introducer_length_m=50e-3, internal_damping_s=5e-3,
    viscous_drag_n_s_m2=0.05, guide_wire=WIRE,
)  # fmt: skip


def body(catheter):
    scene = SceneModel(catheter=catheter, forceps=(WireDriveScene(),), effects={"twist": NoSettings()})
    return CatheterBody(catheter, scene_rod(scene, build_effects(scene).values()))


def settled(rod, ticks=3000):
    for _ in range(ticks):
        rod.predict(1e-3)
    return rod


def stiffnesses(catheter):
    """EI of catheter and wire."""
    wire, inner = catheter.guide_wire, catheter.inner_diameter_m
    second = np.pi / 64.0 * (catheter.outer_diameter_m**4 - inner**4)
    return catheter.youngs_modulus_pa * second, wire.youngs_modulus_pa * np.pi / 64.0 * wire.outer_diameter_m**4


def curvature(rod, first, last):
    """Mean over joints between two particles, in 1/m."""
    edges = np.diff(rod.state.position_m[first:last], axis=0)
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    angles = np.arctan2(np.linalg.norm(np.cross(edges[:-1], edges[1:]), axis=1), np.sum(edges[:-1] * edges[1:], axis=1))
    return float(angles.mean()) / (LENGTH_M / N)


def test_stiffnesses_add():
    """A load aside at the tip bends both as far as a catheter that has the stiffness of both."""
    own, wire = stiffnesses(CATHETER)
    alone = replace(
        CATHETER, guide_wire=None, youngs_modulus_pa=CATHETER.youngs_modulus_pa * (own + wire) / own
    )  # fmt: skip
    moved_m = []
    for catheter in (CATHETER, alone):
        rod = body(catheter)
        before_m = rod.state.position_m[N].copy()
        rod.external_force_n[N, 2] = LOAD_N
        moved_m.append(settled(rod, 20_000).state.position_m[N] - before_m)
    assert moved_m[0][2] == pytest.approx(moved_m[1][2], rel=1e-5)
    free_m = 60e-3 - moved_m[0][0]  # nothing keeps it in its introducer but the stop at its end
    assert moved_m[0][2] == pytest.approx(
        LOAD_N * free_m**3 / (3.0 * (own + wire)), rel=0.03
    )  # and that gives a little


def test_a_stiff_wire_straightens_a_bent_catheter():
    own, wire = stiffnesses(CATHETER)
    rod = settled(body(replace(CATHETER, sections=(BENT,))))
    assert curvature(rod, N - 20, N - 3) == pytest.approx(20.0 * own / (own + wire), rel=1e-3)


def test_it_starts_where_it_rests():
    """Bent as the wire beyond its tip is; nothing springs, and nothing has moved its proximal end."""
    bend = CatheterSection(length_m=14e-3, youngs_modulus_pa=0.3e9, rest_curvature_1_m=(110.0, 0.0, 0.0))
    rod = body(replace(CATHETER, guide_wire=replace(WIRE, sections=(bend,))))
    straight = body(CATHETER).state.position_m
    start_m = rod.state.position_m.copy()
    np.testing.assert_array_equal(start_m[0], straight[0])
    assert np.linalg.norm(start_m[-1] - straight[-1]) > 5e-3
    tangent = np.diff(start_m[-3:], axis=0) / np.linalg.norm(np.diff(start_m[-3:], axis=0), axis=1)[:, None]
    turned_rad = np.arccos(tangent[0] @ tangent[1])
    assert turned_rad == pytest.approx(110.0 * rod.wire.model.rest_length[-1], rel=1e-6)
    settled(rod, 50)
    assert np.abs(rod.state.position_m - start_m)[:, 1:].max() < 1e-9


def test_what_a_bend_asks_for_on_its_way_out_is_as_large_between_joints_as_at_them():
    """A catheter holds its wire's bend straight: for each metre, half of both springs in series times its square."""
    own, wire = stiffnesses(CATHETER)
    bend = CatheterSection(length_m=60e-3, rest_curvature_1_m=(30.0, 0.0, 0.0))
    rod = body(replace(CATHETER, guide_wire=replace(WIRE, sections=(bend,))))
    held_j = [rod.wire.stored_j(rod.state, (out_m, 0.0))[1] for out_m in np.linspace(15e-3, 25e-3, 41)]
    pushes_n = np.diff(held_j) / 0.25e-3
    np.testing.assert_allclose(pushes_n, -0.5 * own * wire / (own + wire) * 30.0**2, rtol=1e-9)


def on_an_arc(radius_m, **wire):
    """The catheter on an arc from its proximal end on, the wire on its way straight on; both bent so at rest."""
    bend = CatheterSection(length_m=LENGTH_M + OUT_M, rest_curvature_1_m=(1.0 / radius_m, 0.0, 0.0))
    catheter = replace(CATHETER, guide_wire=replace(WIRE, sections=(bend,), **wire))
    rod = body(catheter)
    lengths_m = rod.wire.model.rest_length
    turned = (np.cumsum(lengths_m) - 0.5 * lengths_m) / radius_m
    edges = lengths_m[:, None] * np.stack([np.cos(turned), np.sin(turned), np.zeros_like(turned)], axis=1)
    rod.state.position_m[:] = np.concatenate([np.zeros((1, 3)), np.cumsum(edges, axis=0)])
    rod.state.frame = initial_frame(rod.state.position_m, first_m1=(0.0, 0.0, 1.0))
    return rod


@pytest.mark.parametrize("radius_m", [40e-3, 80e-3])
def test_a_push_through_a_bend_grows_as_at_a_capstan(radius_m):
    """The wire is as bent at rest as the catheter, so that nothing but the push presses it on the bend."""
    rod = on_an_arc(radius_m)
    state, tip = rod.state, rod.state.position_m[-1] - rod.state.position_m[N]
    load = np.zeros_like(state.position_m)
    load[-1] = -0.2 / float(tip @ tip) * OUT_M * tip  # that is 0.2 N against the wire on its way
    forward, push, backward, *_ = insertion_forces(
        rod.wire.model.address, state.position_m, frame_of(state), load, rod.wire.place
    )
    grown = np.exp(WIRE.friction * LENGTH_M / radius_m)
    assert push == pytest.approx(0.2, rel=2e-2)
    assert forward / push == pytest.approx(grown, rel=5e-3)
    assert push / backward == pytest.approx(grown, rel=3e-2)


@pytest.mark.parametrize("roll_rad", [0.7, 2.0])
def test_bent_tubes_turned_against_each_other(roll_rad):
    """Their common curvature is the mean of vectors, and the torque that holds them so is in proportion to the sine."""
    own, wire = stiffnesses(CATHETER)
    rest_1_m = 20.0
    bend = CatheterSection(length_m=50e-3 + OUT_M, rest_curvature_1_m=(rest_1_m, 0.0, 0.0))
    rod = body(replace(CATHETER, sections=(BENT,), guide_wire=replace(WIRE, sections=(bend,))))
    rod.wire.set_place((OUT_M, roll_rad))
    settled(rod)
    mean = abs(own * rest_1_m + wire * rest_1_m * np.exp(1j * roll_rad)) / (own + wire)
    assert curvature(rod, N - 20, N - 3) == pytest.approx(mean, rel=2e-3)
    still = np.zeros_like(rod.state.position_m)
    model, frame = rod.wire.model.address, frame_of(rod.state)
    torque = insertion_forces(model, rod.state.position_m, frame, still, rod.wire.place)[3]
    together = own * wire / (own + wire) * rest_1_m**2 * 50e-3
    assert torque == pytest.approx(together * np.sin(roll_rad), rel=0.04)  # of 25 segments, its ends not quite


def test_torsion_is_of_both():
    rod = body(CATHETER)
    tube, wire = (0.5 / (1.0 + nu) for nu in (CATHETER.poisson_ratio, WIRE.poisson_ratio))
    own, other = stiffnesses(CATHETER)
    wanted = 2.0 * (own * tube + other * wire) / (LENGTH_M / N)
    np.testing.assert_allclose(rod.wire.model.torsion[: N - 1], wanted, rtol=1e-9)
    assert wire_tube(WIRE).torsional_stiffness_n_m2() == pytest.approx(2.0 * other * wire)


@given(
    n_segments=st.integers(10, 150),
    out_m=st.floats(5e-3, 40e-3),
    roll_rad=st.floats(-3.0, 3.0),
    parts=st.lists(st.tuples(st.floats(1e-3, 25e-3), st.floats(0.1e9, 2e9), st.floats(0.0, 20.0)), max_size=4),
)
def test_sections_of_a_wire_act_over_their_lengths_wherever_it_is(n_segments, out_m, roll_rad, parts):
    """Compliance and rest turn have the first moments about the tip that their integrals have, at any mesh.

    The catheter is so soft that the wire alone is felt.
    """
    sections = tuple(
        CatheterSection(length_m=length_m, youngs_modulus_pa=modulus_pa, rest_curvature_1_m=(curvature_1_m, 0.0, 0.0))
        for length_m, modulus_pa, curvature_1_m in parts
    )
    first_moments, exact = [], np.zeros(2)
    for each in ((), sections):
        wire = replace(WIRE, sections=each, out_m=out_m)
        catheter = replace(CATHETER, n_segments=n_segments, youngs_modulus_pa=1e-3, guide_wire=wire)
        scene = SceneModel(catheter=catheter, forceps=(WireDriveScene(),), effects={"twist": NoSettings()})
        properties = scene_rod(scene, build_effects(scene).values())
        rod, state = ImplicitIntegrator(properties, Supports()), straight_rod(properties, (0, 0, 0), (1, 0, 0))
        GuideWire(catheter, properties, rod, state).set_place((out_m, roll_rad))
        arc_m = np.cumsum(rod.model.rest_length[::-1])[-2::-1]
        turns_rad = np.linalg.norm(rod.twist.rest_rotation, axis=1)
        first_moments.append([arc_m @ turns_rad, arc_m @ (1.0 / rod.model.joint_stiffness)])
    start_m, second_m4 = 0.0, np.pi / 64.0 * WIRE.outer_diameter_m**4
    for length_m, modulus_pa, curvature_1_m in parts:
        moment_m2 = 0.5 * ((start_m + length_m) ** 2 - start_m**2)
        softer = 1.0 / modulus_pa - 1.0 / WIRE.youngs_modulus_pa
        exact += moment_m2 * np.array([curvature_1_m, softer / second_m4])
        start_m += length_m
    without, found = first_moments
    assert found[0] == pytest.approx(exact[0], rel=1e-6, abs=1e-12)
    assert found[1] - without[1] == pytest.approx(exact[1], rel=1e-6, abs=1e-6 * without[1])


def pressed(push_n, aside_n, steps=400):
    """Particles of the pair, clamped behind, at rest under a push back along its axis at the catheter's tip."""
    scene = SceneModel(catheter=CATHETER, forceps=(WireDriveScene(),), effects={"twist": NoSettings()})
    properties = scene_rod(scene, build_effects(scene).values())
    rod, state = ImplicitIntegrator(properties, Supports(held=(0, 1))), straight_rod(properties, (0, 0, 0), (1, 0, 0))
    GuideWire(CATHETER, properties, rod, state)
    load = np.zeros_like(state.position_m)
    load[N] = (-push_n, 0.0, aside_n)
    for _ in range(steps):
        rod.predict(state, load, 1.0)
        state.halt()
    return state.position_m


FREE_M = (N - 0.5) * LENGTH_M / N  # to the joint in the middle of a clamp's last segment
EULER_N = np.pi**2 * sum(stiffnesses(CATHETER)) / (2.0 * FREE_M) ** 2
CHAIN = (np.pi / (4 * N - 2)) ** 2 / 3.0  # a chain of N joints buckles at 4 EI / l^2 sin^2(pi / (4 N - 2))


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_it_gives_way_aside_as_a_column_of_both_does_near_its_euler_load(share):
    """What the load is off by grows as the way aside does; the chain's error and its shortening are as large."""
    push_n, wave_1_m = share * EULER_N, 0.5 * np.pi * np.sqrt(share) / FREE_M
    aside_n = 1e-4 * push_n
    wanted_m = aside_n / push_n * (np.tan(wave_1_m * FREE_M) / wave_1_m - FREE_M)
    assert pressed(push_n, aside_n)[N, 2] == pytest.approx(wanted_m, rel=2.0 * CHAIN / (1.0 - share))


def test_it_buckles_at_the_euler_load_of_both():
    """Beyond it a column turns its end by an angle of which the load tells (Euler's elastica)."""
    x = pressed(1.05 * EULER_N, 1e-4 * EULER_N)
    turned_rad = np.arccos((x[N] - x[N - 1])[0] / np.linalg.norm(x[N] - x[N - 1]))
    assert (ellipk(np.sin(0.5 * turned_rad) ** 2) / (0.5 * np.pi)) ** 2 == pytest.approx(1.05, rel=1e-3)
