"""Softening law of the wall: the excess work of contact forces as a learned function Y of one number, rho.

For forces a on the sites let V = 1/2 a W a be the linear energy of local deformation, E = 1/6 T a a a the cubic energy
of the linear response, and rho = -E / V. Beyond the work on the linear displacement of their points the forces then do
the work V Y(rho). To first order Y = 3 rho exactly (the second-order response of any structure). The coefficients of Y
are fitted and vary over the wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray

FIRST = 3.0
"""Coefficient of the first part: the exact second-order response."""
FIRST_TURNS = 0.5
"""rho at which the first part, linear near zero, has saturated by half."""
TURNS = (0.1, 0.3, 0.8, 2.0)
"""rho at which the other parts for pressed walls reach a half."""
OUTWARD_TURNS = 0.35
"""The same of the part for walls that are pulled outward."""
N_PARTS = 2 + len(TURNS)
N_POINTS = 193
"""Of the grid over rho on which Y is tabulated."""
LARGEST_RHO = 2.5
"""Beyond it Y is constant. A wider grid of as many points would resolve Y too coarsely near zero."""
NOISE = 0.03
"""Standard deviation of the reference's relative closures that the law does not explain."""
MEAN_SCALE, LOCAL_SCALE = 5.0, 0.5
"""Prior standard deviations of the coefficients' mean over the wall, and of their variation along it."""
LOCAL_SCALE_OF_NODES = 0.7
"""The same for the law of the nodes, larger because less of the variation comes from how the sites lie."""
SMOOTH_WIDTHS = 1.5
"""Correlation length of the coefficients, in widths of the lumen."""
SUPPORT_SCALE, SUPPORT_WIDTHS = 5.0, 0.35
"""Additional variation beside a support, and the length over which it decays in widths of the lumen: the wall
cannot ovalise there, so it is stretched."""

FADE_WIDTHS = (1.0, 2.0)
"""Distances from the nearest support, in widths of the lumen, between which the law of the sites fades into that of the
nodes."""


def parts(rho: FloatArray) -> FloatArray:
    """(N_PARTS, ...) basis functions of Y: one that starts as rho, some for pressed walls, one for walls pulled out.

    All saturate, as Y does. A stretched wall beside a support bears any force (rho reaches 5 where it is thin), and
    powers of rho would fit such states at the expense of all others.
    """
    inward, outward = np.maximum(rho, 0.0), np.minimum(rho, 0.0)
    saturating = [inward**2 / (inward**2 + turn**2) for turn in TURNS]
    first = rho / (1.0 + np.abs(rho) / FIRST_TURNS)
    return np.stack([first, *saturating, outward**2 / (outward**2 + OUTWARD_TURNS**2)])


@dataclass(frozen=True, slots=True)
class Sample:
    """One equilibrium of the nonlinear reference, a data point of the fit.

    Attributes:
        excess: float. Y of this state.
        share: float. V over the work of the forces: how much an error of Y counts.
        place: (n,) float64. Shares of the nodes in the force, not negative, of sum one.
    """

    rho: float
    excess: float
    share: float
    place: FloatArray


@dataclass(frozen=True, slots=True)
class SofteningLaw:
    """Y, made of parts.

    Attributes:
        rho: (p,) float64. Evenly spaced from the least to the largest that was seen; beyond them Y stays what it is
            there.
        work: (N_PARTS, p) float64. The parts of Y.
        coefficients: (n, N_PARTS) float64. Of the parts, for forces on each node of the wall.
    """

    rho: FloatArray
    work: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True, slots=True)
class TwoLaws:
    """The softening laws of a wall: of the nodes far from supports, of the sites beside them.

    Attributes:
        of_sites: SofteningLaw. For the energies that forces have once they are spread over the sites, scaled.
        of_nodes: SofteningLaw. For those that they have themselves; over the same rho. Of no nodes where the wall's
            `Remainder` is not known.
        share: (n,) float64. Of the second law, for forces on each node: of a load the mean over its nodes, counted by
            the forces on them.
    """

    of_sites: SofteningLaw
    of_nodes: SofteningLaw
    share: FloatArray


def share_of_nodes(from_support: FloatArray) -> FloatArray:
    """(n,) shares of the law of the nodes, given how far these are from a support in widths of the lumen: smooth.

    Beside a support the more exact energies of the nodes do not improve the fit: a stretched wall also depends on how
    wide it is pressed.
    """
    first, last = FADE_WIDTHS
    part = np.clip((from_support - first) / (last - first), 0.0, 1.0)
    share: FloatArray = part * part * (3.0 - 2.0 * part)
    return share


def over_same_rho(first: SofteningLaw, second: SofteningLaw) -> tuple[SofteningLaw, SofteningLaw]:
    """Both laws at the points of one grid; beyond its own points either stays what it is there."""
    ends = [(law.rho[0], law.rho[-1]) for law in (first, second)]
    grid = _grid(min(low for low, _ in ends), max(high for _, high in ends))
    one, other = (
        replace(law, rho=grid, work=parts(np.clip(grid, *end))) for law, end in zip((first, second), ends, strict=True)
    )
    return one, other


def place_of(n_nodes: int, nodes: IntArray, force_n: FloatArray) -> FloatArray:
    """(n,) shares of the nodes of a wall in forces (k, 3) on some of them."""
    share = np.zeros(n_nodes)
    np.add.at(share, nodes, np.linalg.norm(force_n, axis=1))
    share /= share.sum()
    return share


def alike(
    distance: FloatArray, from_support: FloatArray, other_from_support: FloatArray, local_scale: float = LOCAL_SCALE
) -> FloatArray:
    """(n, s) prior covariance of the coefficients' variation at n places with that at s others.

    ``distance`` (n, s) is between them, ``from_support`` (n,) and (s,) how far each is from the nearest support, in
    widths of the lumen.
    """
    beside, other_beside = (np.exp(-far / SUPPORT_WIDTHS) for far in (from_support, other_from_support))
    smooth = np.exp(-0.5 * (distance / SMOOTH_WIDTHS) ** 2)
    covariance: FloatArray = local_scale**2 * smooth + SUPPORT_SCALE**2 * np.outer(beside, other_beside)
    return covariance


def fit_law(samples: Sequence[Sample], among: FloatArray, to: FloatArray) -> SofteningLaw:
    """Least squares with a Gaussian prior: coefficients vary smoothly, and with how near a support is.

    ``among`` (s, s) is how `alike` the nodes of the wall are that the samples are of, ``to`` (n, s) how the nodes of
    the wall that the law is for are to them.
    """
    rho = np.array([sample.rho for sample in samples])
    share = np.array([sample.share for sample in samples])
    first, *others = parts(rho)
    wanted = share * (np.array([sample.excess for sample in samples]) - FIRST * first)
    seen = share * np.stack(others)
    places = np.stack([sample.place for sample in samples])
    kernel = MEAN_SCALE**2 + places @ among @ places.T
    covariance = kernel * (seen.T @ seen) + NOISE**2 * np.eye(len(rho))
    dual = np.linalg.solve(covariance, wanted)
    at_nodes = MEAN_SCALE**2 + to @ places.T
    fitted = at_nodes @ (seen * dual).T
    coefficients = np.concatenate([np.full((len(fitted), 1), FIRST), fitted], axis=1)
    grid = _grid(*np.clip([min(rho.min(), -0.05), max(rho.max(), 0.05)], -LARGEST_RHO, LARGEST_RHO))
    return SofteningLaw(grid, parts(grid), coefficients)


def _grid(first: float, last: float) -> FloatArray:
    """Return evenly spaced points that include zero, where the piecewise linear law must vanish exactly."""
    step = (last - first) / (N_POINTS - 1)
    grid: FloatArray = step * (np.arange(N_POINTS) - np.ceil(-first / step))
    return grid
