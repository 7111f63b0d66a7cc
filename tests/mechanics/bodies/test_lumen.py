"""Who is in the lumen: by the winding number of the closed surface, an independent answer, for catheters anywhere."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.bodies.lumen import MovingLumen
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.mesh import boundary_loops
from trocar.services.mechanics.surface.rim_caps import fill_rim

N = 40


@pytest.fixture(scope="module", params=["plain", "slit", "oblique"])
def duct(request, small_scene, cache_dir):
    cut = {"plain": {}, "slit": {"slit_length_m": 10e-3, "slit_width_m": 3e-3}, "oblique": {"cut_angle_rad": 0.7}}
    scene = replace(small_scene, duct=replace(small_scene.duct, **cut[request.param]))
    return build_scene_duct(scene, cache_dir)


def winding(p, vertices, triangles):
    """Solid angle of a closed surface over 4 pi (van Oosterom and Strackee, 1983): one inside, zero outside."""
    a, b, c = (vertices[triangles[:, k]] - p for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    beside = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return abs(np.arctan2((a * np.cross(b, c)).sum(1), beside).sum() / (2.0 * np.pi))


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_inside_is_what_wall_and_caps_go_round(duct, seed):
    """A thread that goes in and out by the openings: its points are drawn clear of the wall, and never through it."""
    rng, mesh = np.random.default_rng(seed), duct.mesh
    caps = [fill_rim(mesh.vertices_m, rim) for rim in boundary_loops(mesh)]
    closed = np.concatenate([mesh.triangles, *caps])
    radius_m = 0.5 * np.linalg.norm(mesh.vertices_m[:, 1:], axis=1).min()
    end_m = mesh.vertices_m[:, 0].max()
    x = np.cumsum(np.concatenate([[end_m + 4e-3], rng.uniform(-2e-3, 1e-3, N - 1)]))
    angle, off = rng.uniform(0.0, 6.28, N), radius_m * np.sqrt(rng.random(N))
    thread = np.stack([x, off * np.cos(angle), off * np.sin(angle)], axis=1)
    lumen = MovingLumen(duct, N)
    place = lumen.follow(np.zeros(duct.basis.n_modes), thread)
    expected = [winding(p, mesh.vertices_m, closed) > 0.5 for p in thread]
    assert lumen.inside.astype(bool).tolist() == expected
    assert (place >= 0.0) == expected[-1]
    assert lumen.entered_by == ("mouth" if expected[-1] and not all(expected) else "")
    if expected[-1] and not all(expected):
        last_out = N - 1 - expected[::-1].index(False)
        assert last_out <= place < last_out + 1


def test_a_base_that_is_carried_through_an_opening_changes_its_side(duct):
    q, lumen, end_m = np.zeros(duct.basis.n_modes), MovingLumen(duct, 2), duct.mesh.vertices_m[:, 0].max()
    for x in np.arange(end_m + 8e-3, end_m - 15e-3, -0.5e-3):
        lumen.follow(q, np.array([[x, 0.0, 0.0], [x + 1e-4, 0.0, 0.0]]))
    assert lumen.inside.all()
    for x in np.arange(end_m - 15e-3, end_m + 8e-3, 0.5e-3):
        lumen.follow(q, np.array([[x, 0.0, 0.0], [x + 1e-4, 0.0, 0.0]]))
    assert not lumen.inside.any()
