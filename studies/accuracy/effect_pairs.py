"""Every pair of effects as a matrix, each effect alone on its diagonal, and which pairs are more than both alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LogNorm, Normalize, SymLogNorm
from matplotlib.figure import SubFigure

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.accuracy.study import Row

COST = "cost of a tick"
_DECADES = 3.0
"""What is smaller than the largest by more than so many powers of ten has the colour of nothing."""
_ALIKE = 0.01
_SHOWN = 1
"""Pairs that are named."""
_BESIDE = 2
_WITHIN_NOISE = "0.55"


@dataclass(frozen=True, slots=True)
class Matrix:
    """One quantity of all effects and pairs, as it differs from what is unchanged.

    Attributes:
        title: str
        unit: str
        values: (n, n) float64. Symmetric; on the diagonal each effect alone. Not finite where two do not go together or
            were not tried.
        noise: (n, n) float64. What a value may be by chance: zero but of costs.
        is_signed: bool
    """

    title: str
    unit: str
    values: FloatArray
    noise: FloatArray
    is_signed: bool


def changed_in(row: Row) -> tuple[str, ...]:
    """Return the effects that a row's setting has more or less."""
    return tuple(str(row.choices["changed"]).split())


def matrices(rows: Sequence[Row], quantities: Sequence[str], signed: Sequence[str]) -> list[Matrix]:
    """Return the cost, where it was measured, then these quantities."""
    names = effects_in(rows)
    every = []
    base = next(row for row in rows if not changed_in(row))
    one_each = [row for row in rows if row.quantity == base.quantity]
    if base.cost is not None:
        own = base.cost
        timed = [(row, row.cost) for row in one_each if row.cost is not None]
        extra = {changed_in(row): cost.median_us - own.median_us for row, cost in timed}
        noise = {changed_in(row): cost.noise_us + own.noise_us for row, cost in timed}
        every.append(Matrix(COST, "us", _filled(names, extra), _filled(names, noise), is_signed=True))
    for quantity in quantities:
        mine = [row for row in rows if row.quantity == quantity]
        values = _filled(names, {changed_in(row): row.error for row in mine})
        unit, is_signed = mine[0].unit, quantity in signed
        every.append(Matrix(quantity, unit, values, np.zeros(values.shape), is_signed=is_signed))
    return every


def effects_in(rows: Sequence[Row]) -> list[str]:
    """Return the effects that were tried alone, in their order."""
    return list(dict.fromkeys(changed_in(row)[0] for row in rows if len(changed_in(row)) == 1))


def _filled(names: Sequence[str], values: Mapping[tuple[str, ...], float]) -> FloatArray:
    matrix = np.full((len(names), len(names)), np.nan)
    for changed, value in values.items():
        if changed and all(name in names for name in changed):
            one, two = names.index(changed[0]), names.index(changed[-1])
            matrix[one, two] = matrix[two, one] = value
    return matrix


def beyond_both(matrix: Matrix) -> FloatArray:
    """Return by how much a pair (n, n) differs from what both alone can come to, noise taken off; zero if it does not.

    What has a sign adds up. A root mean square, or a largest length, of two changes that leave each other alone lies
    between the difference and the sum of both. A hundredth of the larger is no difference.
    """
    alone, noise = np.diag(matrix.values), np.diag(matrix.noise)
    low = high = alone[:, None] + alone
    if not matrix.is_signed:
        low = np.abs(alone[:, None] - alone)
    larger = np.maximum(np.abs(alone)[:, None], np.abs(alone))
    spread = np.maximum(matrix.noise + noise[:, None] + noise, _ALIKE * larger)
    above, below = matrix.values - high - spread, low - matrix.values - spread
    beyond = np.where(above > 0.0, above + spread, np.where(below > 0.0, -(below + spread), 0.0))
    np.fill_diagonal(beyond, 0.0)
    beyond[~np.isfinite(matrix.values)] = 0.0
    return beyond


def told_pairs(matrix: Matrix, words: Sequence[str], number: Callable[[float], str]) -> str:
    """Say of a quantity how many pairs come to what both alone can, and name those that are furthest from it."""
    beyond = beyond_both(matrix)
    rows, columns = np.tril_indices(len(words), -1)
    tried = np.isfinite(matrix.values[rows, columns])
    rows, columns = rows[tried], columns[tried]
    apart = beyond[rows, columns]
    furthest = [k for k in np.argsort(-np.abs(apart), kind="stable")[:_SHOWN] if abs(apart[k]) > 0.0]
    alike = (
        f"{matrix.title}: in {np.count_nonzero(apart == 0.0)} of {len(apart)} pairs the effects act independently, "
        "within 1 % or the noise"
    )
    if not furthest:
        return alike
    named = (
        f"{words[columns[k]]} and {words[rows[k]]}: {number(matrix.values[rows[k], columns[k]])} {matrix.unit} "
        f"({number(abs(apart[k]))} {'more' if apart[k] > 0.0 else 'less'})"
        for k in furthest
    )
    return f"{alike}; the largest deviation is {', '.join(named)}"


def draw_matrices(figure: SubFigure, every: Sequence[Matrix], words: Sequence[str]) -> None:
    """Draw them two beside each other, with names at the left and below."""
    lines = (len(every) + _BESIDE - 1) // _BESIDE
    for place, matrix in enumerate(every):
        axes = figure.add_subplot(lines, _BESIDE, place + 1)
        _draw(axes, matrix)
        axes.set_xticks(range(len(words)), words if place + _BESIDE >= len(every) else [], rotation=90, fontsize=7)
        axes.set_yticks(range(len(words)), [] if place % _BESIDE else words, fontsize=7)


def _draw(axes: Axes, matrix: Matrix) -> None:
    n = len(matrix.values)
    colours, scale = _scale(matrix)
    is_clear = np.tri(n, dtype=bool) & ~(np.abs(matrix.values) < matrix.noise)
    shown = np.where(is_clear, matrix.values, np.nan)
    axes.imshow(shown if matrix.is_signed else np.maximum(shown, scale.vmin or 0.0), cmap=colours, norm=scale)
    for row, column in product(range(n), repeat=2):
        if column <= row:
            ink = _ink(colours(scale(shown[row, column]))) if is_clear[row, column] else _WITHIN_NOISE
            told, weight = _short(matrix.values[row, column]), "bold" if row == column else "normal"
            axes.text(column, row, told, ha="center", va="center", fontsize=6, color=ink, weight=weight)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(f"{matrix.title} [{matrix.unit}]", fontsize=9)


def _ink(colour: tuple[float, float, float, float]) -> str:
    """Return what can be read on a colour."""
    red, green, blue, opaque = colour
    return "white" if opaque and 0.3 * red + 0.59 * green + 0.11 * blue < 0.5 else "black"


def _short(value: float) -> str:
    """Return what has room in a cell; what is below half a hundredth is nothing."""
    if not np.isfinite(value):
        return "\N{EN DASH}"
    if abs(value) < 0.005:
        return "0"
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.1f}" if abs(value) >= 0.995 else f"{value:.2f}"


def _scale(matrix: Matrix) -> tuple[Colormap, Normalize]:
    largest = float(np.nanmax(np.abs(matrix.values), initial=0.0)) or 1.0
    if matrix.is_signed:
        linear = max(float(np.nanmax(matrix.noise)), largest * 10.0**-_DECADES)
        return colormaps["RdBu_r"], SymLogNorm(linear, vmin=-largest, vmax=largest)
    return colormaps["Blues"], LogNorm(largest * 10.0**-_DECADES, largest)
