import numpy as np
import pytest

from services.mechanics.rod import smooth_centreline


def arc(n):
    angle = np.linspace(0.0, 1.5 * np.pi, n)
    return 0.03 * np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)


def test_the_curve_passes_through_every_particle():
    particles = arc(21)
    points, tangents = smooth_centreline(particles, 5)
    assert points.shape == tangents.shape == (101, 3)
    np.testing.assert_allclose(points[::5], particles, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0)


def test_between_the_particles_it_converges_to_the_curve_with_the_fourth_power():
    def distance(n):
        points, _ = smooth_centreline(arc(n), 8)
        middle = points[len(points) // 4 : -len(points) // 4]
        return np.abs(np.linalg.norm(middle[:, :2], axis=1) - 0.03).max()

    n = np.array([17, 33, 65])
    rate = -np.polyfit(np.log(n - 1), np.log([distance(int(k)) for k in n]), 1)[0]
    assert rate == pytest.approx(4.0, abs=0.3)


def test_particles_that_coincide_are_named():
    particles = arc(21)
    particles[7] = particles[8]
    with pytest.raises(ValueError, match="7 and 8"):
        smooth_centreline(particles)
