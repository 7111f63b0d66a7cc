import numpy as np
import pytest

from trocar.services.mechanics.contact.admissible import minimise_in_disk


def random_positive(rng, n):
    A = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-1, 1, n)
    return A @ A.T + 1e-3 * np.eye(n)


@pytest.mark.parametrize("seed", range(20))
def test_bounded_minimisers_stick_inside_and_slip_against_the_force_on_the_edge(seed):
    rng = np.random.default_rng(seed)
    W, r = random_positive(rng, 2), rng.standard_normal(2)
    stuck = np.linalg.solve(W, -r)
    for factor in (0.01, 0.5, 2.0):
        radius = factor * np.linalg.norm(stuck)
        f = np.array(minimise_in_disk(W[0, 0], W[0, 1], W[1, 1], r[0], r[1], radius))
        motion = W @ f + r
        if factor > 1.0:
            assert np.allclose(f, stuck, rtol=1e-9)
        else:
            assert np.linalg.norm(f) == pytest.approx(radius, rel=1e-9)
            # Maximal dissipation: the motion is a negative multiple of the force.
            cosine = motion @ f / np.linalg.norm(motion) / radius
            assert cosine == pytest.approx(-1.0, abs=1e-6)
