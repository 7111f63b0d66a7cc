"""Laws of the membrane, one file each: how a wall's energy grows with its strain.

Adding one: a file with a density and its row here, see `docs/how-to/recipes.md`.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.reduction.membrane_laws import fibres, fung, neo_hookean, saint_venant
from trocar.services.mechanics.reduction.membrane_laws.law import MembraneLaw, Response, Strain

MEMBRANE_LAWS: dict[str, MembraneLaw] = {
    "fung": fung.LAW,
    "neo_hookean": neo_hookean.LAW,
    "fibres": fibres.LAW,
    "saint_venant": saint_venant.LAW,
}
_fung, _neo_hookean, _fibres, _saint_venant = (law.density for law in MEMBRANE_LAWS.values())


@kernel
def _other(law: int, strain: Strain, parameters: FloatArray) -> Response:
    """Return the response of any law but the first."""
    if law == 1:
        return _neo_hookean(strain, parameters)
    if law == 2:
        return _fibres(strain, parameters)
    return _saint_venant(strain, parameters)


@inlined_kernel
def density_of(law: int, strain: Strain, parameters: FloatArray) -> Response:
    """Return the response of the law of that number, its place in the table.

    That of the first, the usual one, is compiled into what calls it, which makes it a third faster.
    """
    if law == 0:
        return _fung(strain, parameters)
    return _other(law, strain, parameters)


def law_number(name: str) -> int:
    """Return the place of a law in the table. Raises ValueError if there is no such law; the message lists them."""
    if name not in MEMBRANE_LAWS:
        raise ValueError(f"unknown law of the membrane '{name}'; known: {', '.join(MEMBRANE_LAWS)}")
    return list(MEMBRANE_LAWS).index(name)


def parameters_of(name: str, given: dict[str, float]) -> tuple[float, ...]:
    """Return the parameters of a law in its order, the usual value where none is given.

    Raises ValueError: a parameter that the law has not, or out of its range.
    """
    known = MEMBRANE_LAWS[name].parameters
    for key in given:
        if key not in known:
            has = f"has {', '.join(known)}" if known else "has none"
            raise ValueError(f"the law '{name}' has no parameter {key}, it {has}")
    values = tuple(float(given.get(key, usual)) for key, (usual, _, _) in known.items())
    for value, (key, (_, least, most)) in zip(values, known.items(), strict=True):
        if not least <= value <= most:
            raise ValueError(f"{key} of the law '{name}' must be within {least:g} and {most:g}, is {value:g}")
    return values


__all__ = ["MEMBRANE_LAWS", "MembraneLaw", "Response", "Strain", "density_of", "law_number", "parameters_of"]
