"""How far the wall gives way: one function of one number, its coefficients learned and varying over the wall.

For forces a on the sites let V = 1/2 a W a be the linear energy of local deformation, E = 1/6 T a a a the cubic energy
of the linear response to them, and rho = -E / V. Beyond the linear displacement of the points they act on the forces
then do the work V Y(rho); to first order Y = 3 rho exactly (the second-order response of any structure).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray

FIRST = 3.0
"""Coefficient of the first part."""
FIRST_TURNS = 0.5
"""Where the first part, rho at first, has come to half of what it would be."""
TURNS = (0.1, 0.3, 0.8, 2.0)
"""Where the other parts for walls pressed in turn; where the one for walls pulled out does."""
OUTWARD_TURNS = 0.35
N_PARTS = 2 + len(TURNS)
N_POINTS = 193
LARGEST_RHO = 2.5
"""Beyond it the law stays what it is there: as far as points that are evenly spread follow what it does near zero."""
NOISE = 0.03
"""Scatter of the reference's closures that the law does not explain, over the closure."""
MEAN_SCALE, LOCAL_SCALE = 5.0, 0.5
"""Spread expected of the coefficients, and of what they vary by from place to place."""
LOCAL_SCALE_OF_NODES = 0.7
"""The same where energies are right: less of what is left is how sites lie."""
SMOOTH_WIDTHS = 1.5
"""Distance over which they vary, in widths of the lumen."""
SUPPORT_SCALE, SUPPORT_WIDTHS = 5.0, 0.35
"""What they vary by beside a support, and within which distance: the wall cannot ovalise there, and is stretched."""

FADE_WIDTHS = (1.0, 2.0)
"""Of the lumen from the nearest support: nearer than the first the law of the sites holds, beyond the last that of the
nodes."""


def parts(rho: FloatArray) -> FloatArray:
    """(N_PARTS, ...) what Y is made of: rho at first, others for walls pressed in, one for walls pulled out.

    All saturate, as Y does: a wall that is stretched, beside a support, holds forces without end (rho of 5 where it is
    thin) and gives way by no less than nothing. Powers of rho were fitted to such a wall at the expense of all others.
    """
    inward, outward = np.maximum(rho, 0.0), np.minimum(rho, 0.0)
    saturating = [inward**2 / (inward**2 + turn**2) for turn in TURNS]
    first = rho / (1.0 + np.abs(rho) / FIRST_TURNS)
    return np.stack([first, *saturating, outward**2 / (outward**2 + OUTWARD_TURNS**2)])


@dataclass(frozen=True, slots=True)
class Sample:
    """One equilibrium of the reference as the law sees it.

    Attributes
    ----------
    rho : float
    excess : float
        What Y should be.
    share : float
        V over the work of the forces: how much an error of Y counts.
    place : (n,) float64
        Shares of the nodes in the force, not negative, of sum one.
    """

    rho: float
    excess: float
    share: float
    place: FloatArray


@dataclass(frozen=True, slots=True)
class SofteningLaw:
    """Y, made of parts.

    Attributes
    ----------
    rho : (p,) float64
        Evenly spaced from the least to the largest that was seen; beyond them Y stays what it is there.
    work : (N_PARTS, p) float64
        The parts of Y.
    coefficients : (n, N_PARTS) float64
        Of the parts, for forces on each node of the wall.
    """

    rho: FloatArray
    work: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True, slots=True)
class TwoLaws:
    """What a wall gives way by where it is pressed far from supports, and where it is beside them.

    Attributes
    ----------
    of_sites : SofteningLaw
        For the energies that forces have once they are spread over the sites, scaled.
    of_nodes : SofteningLaw
        For those that they have themselves; over the same rho. Of no nodes where the wall's `Remainder` is not known.
    share : (n,) float64
        Of the second law, for forces on each node: of a load the mean over its nodes, counted by the forces on them.
    """

    of_sites: SofteningLaw
    of_nodes: SofteningLaw
    share: FloatArray


def share_of_nodes(from_support: FloatArray) -> FloatArray:
    """(n,) shares of the law of the nodes, given how far these are from a support in widths of the lumen: smooth.

    Beside a support energies that are right make nothing better: what a wall that is stretched does goes with how wide
    it is pressed as well.
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
    """(n, s) covariance of what the coefficients vary by at n places with that at s others.

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
    """Evenly spaced, zero among them: between points the law is a straight line, and it has to end in nothing."""
    step = (last - first) / (N_POINTS - 1)
    grid: FloatArray = step * (np.arange(N_POINTS) - np.ceil(-first / step))
    return grid
