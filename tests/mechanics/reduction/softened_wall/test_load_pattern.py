"""The potential of a pattern: the integral of its force, concave where the wall gives way, within its bounds."""

import numpy as np
import pytest

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, reader
from trocar.services.mechanics.reduction.softened_wall import load_pattern as law
from trocar.services.mechanics.reduction.softened_wall.load_pattern import (
    DELIVERED,
    GAIN,
    LINEAR,
    MOST_SOFTENING,
    MOST_STIFFENING,
    MOST_TURNED,
    PART,
    RHO,
    TURN,
    Pattern,
)

KNOTS = 0.01 * np.arange(-40, 120)
pattern_at = reader(Pattern)


@kernel
def bound(address: Address[Pattern]) -> None:
    law.bound_law(pattern_at(address))
    law.integrate_law(pattern_at(address))


@kernel
def evaluate_all(address: Address[Pattern], s: float) -> tuple[float, float, float]:
    return law.evaluate(pattern_at(address), s)


@kernel
def mean_slope(address: Address[Pattern], start: float, end: float, out: FloatArray) -> None:
    pattern = pattern_at(address)
    pattern.tangent[0] = 0.0
    law.add_mean_pattern_slope(pattern, start, end, out)


def evaluate(address, s):
    return evaluate_all(address, s)[:2]


def giving(rho, squared=2.0, saturating=1.0):
    """Y of a wall that gives way where it is pressed, and less and less stiffens where it is pulled."""
    inward, outward = np.maximum(rho, 0.0) ** 2, np.minimum(rho, 0.0)
    falls = inward / (inward + 0.15**2) + 0.5 * inward / (inward + 0.35**2)
    return 3.0 * rho + saturating * falls + squared * inward - 3.0 * outward**2 / (1.0 - outward)


def turning(rho, squared=-6.0):
    """3 rho - 6 rho^2."""
    return giving(rho, squared, 0.0)


def made(rho, delivered, work=giving):
    pattern = Pattern.zeros(r=1, p=len(KNOTS), rho_first=KNOTS[0], rho_step=KNOTS[1] - KNOTS[0])
    pattern.work[:] = work(KNOTS)
    pattern.numbers[[LINEAR, DELIVERED, GAIN, RHO, PART]] = 1.0, delivered, 1.0, rho, 1.0
    bound(pattern.address)
    return pattern


@pytest.mark.parametrize("rho", [0.05, 0.6, -0.05, -0.6])
@pytest.mark.parametrize("delivered", [0.5, 2.0, 40.0])
def test_the_force_is_the_slope_of_the_potential(rho, delivered):
    pattern, s = made(rho, delivered), np.linspace(0.0, 6.0, 601)
    phi, potential = np.array([evaluate(pattern.address, x) for x in s]).T
    slope = np.gradient(potential, s)
    np.testing.assert_allclose(-slope[1:-1], phi[1:-1], atol=2e-3 * np.abs(phi).max())
    assert phi[0] == potential[0] == 0.0
    stiffness = np.gradient(phi, s) * delivered
    assert np.all(np.sign(rho) * phi[1:] > 0.0)
    assert stiffness.max() <= MOST_SOFTENING + 1e-9
    assert stiffness.min() >= (0.0 if rho > 0.0 else -MOST_STIFFENING / (1.0 - MOST_STIFFENING)) - 1e-9


def test_the_law_is_met_where_it_is_within_the_bounds():
    """Loads theta a displace by theta (m . t) + phi (t . K t); phi is theta Y(theta rho)."""
    pattern = made(0.3, 1.0)
    for theta in (0.3, 1.0, 2.0):
        work = np.interp(theta * 0.3, KNOTS, giving(KNOTS))
        phi, _ = evaluate(pattern.address, theta + theta * work)
        assert phi == pytest.approx(theta * work, rel=1e-9)


@pytest.mark.parametrize("rho", [0.6, -0.3])
def test_the_mean_force_of_a_step_does_the_work_of_the_potential(rho):
    """Whatever the way, also over the point where the wall is at rest; its derivative is that of differences."""
    pattern, random = made(rho, 2.0), np.random.default_rng(2)
    for _ in range(100):
        start = random.uniform(-1.0, 5.0)
        end = start + random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-6.0, 0.5)

        def slope(to, start=start):
            mean_slope(pattern.address, start, to, out := np.zeros(1))
            return out[0]

        fell = evaluate(pattern.address, end)[1] - evaluate(pattern.address, start)[1]
        assert slope(end) * (end - start) == pytest.approx(fell, rel=1e-6, abs=1e-12)
        step = 1e-5
        slope(end)
        tangent = float(pattern.tangent[0])
        assert tangent == pytest.approx((slope(end + step) - slope(end - step)) / (2.0 * step), rel=0.02, abs=0.02)


@pytest.mark.parametrize("rho", [0.05, 0.6, -0.05, -0.6])
def test_the_tangent_is_the_derivative_of_the_force(rho):
    """But for the points of the law, which is straight between them."""
    pattern, s = made(rho, 2.0), np.random.default_rng(3).uniform(0.1, 5.0, 100)
    slope = np.array([evaluate_all(pattern.address, x)[2] for x in s])
    ahead, behind = (np.array([evaluate(pattern.address, x)[0] for x in s + d]) for d in (1e-6, -1e-6))
    assert np.median(np.abs((ahead - behind) / 2e-6 - slope)) < 1e-6


def test_the_other_way_there_is_no_force():
    assert evaluate(made(0.3, 1.0).address, -1.0) == (0.0, 0.0)


@pytest.mark.parametrize("delivered", [0.5, 2.0])
def test_a_law_that_turns_is_the_slope_of_a_concave_and_of_a_convex_part(delivered):
    """3 rho - 6 rho^2: phi grows up to a third of rho, is nothing at half of it, and pushes back beyond."""
    pattern, s = made(0.6, delivered, turning), np.linspace(0.0, 6.0, 2001)
    phi, potential = np.array([evaluate(pattern.address, x) for x in s]).T
    work = np.cumsum(0.5 * (phi[1:] + phi[:-1]) * np.diff(s))
    np.testing.assert_allclose(-potential[1:], work, atol=2e-5 * np.abs(work).max())
    assert phi.max() > 0.0 > phi.min()
    stiffness = np.gradient(phi, s) * delivered
    assert stiffness.min() >= -MOST_TURNED / (1.0 - MOST_TURNED) - 1e-6
    top = s[phi.argmax()]
    assert np.all(stiffness[s < top - 0.01] >= -1e-9)
    assert np.all(stiffness[s > top + 0.01] <= 1e-9)
    if delivered == 0.5:  # within the bounds
        assert pattern.numbers[TURN] == pytest.approx(1.0 / 3.0, abs=0.011)


def test_a_law_that_turns_late_turns():
    """3 rho - 3 rho^2: rho Y grows up to two thirds of 1.19, the largest rho, and is below nothing at its end."""
    late = made(0.6, 0.5, lambda rho: turning(rho, -3.0))
    assert late.numbers[TURN] == pytest.approx(2.0 / 3.0, abs=0.011)
    assert evaluate(late.address, 6.0)[0] < 0.0


def test_a_law_that_ends_flat_does_not_turn():
    """Where nothing was learned the law goes on as it may: it is held from falling."""
    assert made(0.6, 0.5, lambda rho: turning(rho, -2.0)).numbers[TURN] == np.inf
    assert made(-0.3, 0.5, turning).numbers[TURN] == 0.0


def test_a_wall_that_is_pulled_may_hold_three_times_as_much():
    """By its law, Y = -2/3; twice as much was all that it could hold."""
    pattern = made(-0.3, 1.0, lambda rho: -2.0 / 3.0 * (rho < 0.0))
    phi, _ = evaluate(pattern.address, 2.0 - 4.0 / 3.0)
    assert phi == pytest.approx(-4.0 / 3.0, rel=1e-6)


def test_a_law_that_ends_below_nothing_stays_there():
    """Beyond the largest rho that was learned a wall that is stretched goes on being so: phi falls with theta."""
    pattern = made(0.6, 0.5, turning)
    end, slope = pattern.work[-1], np.diff([evaluate(pattern.address, s)[0] for s in (4.0, 5.0, 6.0)])
    assert end < 0.0
    np.testing.assert_allclose(slope, end / (1.0 + 0.5 * end), rtol=1e-6)
