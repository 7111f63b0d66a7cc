import numpy as np
import pytest

from trocar.services.mechanics.reduction.modal_compliance import add_modal_compliance


@pytest.mark.parametrize("n_modes", [7, 40])
def test_modal_compliance_of_the_lowest_modes_is_added_to_the_lower_blocks(n_modes):
    rng = np.random.default_rng(3)
    modes, gain = rng.standard_normal((12, 40)), rng.uniform(0.1, 1.0, 40)
    start = rng.standard_normal((12, 12))
    W = start.copy()
    add_modal_compliance(modes, gain[:n_modes], np.zeros(12 * 40), W, np.arange(4, dtype=np.int32), 0)
    expected = start + (modes[:, :n_modes] * gain[:n_modes]) @ modes[:, :n_modes].T
    for row in range(12):
        last = 3 * (row // 3) + 3
        assert np.allclose(W[row, :last], expected[row, :last], atol=1e-12)
        assert np.array_equal(W[row, last:], start[row, last:])
