"""A tissue that a scene file names: it says of the wall what the file leaves open."""

from __future__ import annotations

from typing import Any

from trocar.services.mechanics.scene.tissue import TISSUES, Tissue, tissue
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError


def take_tissue(data: dict[str, Any], where: str, origins: config.Origins) -> None:
    """Write what ``duct.tissue`` says into ``data`` and ``origins``, beside what the file and the overrides say.

    An orthotropic wall brings the effect ``anisotropy``; relaxation is taken where the scene has
    ``viscoelasticity``, the exponent of stiffening where it has ``hyperelasticity``.
    Raises ConfigError if there is no such tissue.
    """
    duct, effects = data.get("duct"), data.get("effects", {})
    name = duct.get("tissue") if isinstance(duct, dict) else None
    if not isinstance(name, str):
        return
    try:
        chosen = tissue(name)
    except ValueError as error:
        raise ConfigError(f"{where}: duct.tissue: {error}{did_you_mean(name, TISSUES)}") from None
    if chosen.is_orthotropic and "effects" not in data:
        data["effects"] = effects = {}
    _fill(duct, _wall(chosen), "duct", name, origins)
    if not isinstance(effects, dict):
        return
    if chosen.is_orthotropic:
        effects.setdefault("anisotropy", {})
    every = {
        "anisotropy": _anisotropy(chosen),
        "viscoelasticity": _viscoelasticity(chosen),
        "hyperelasticity": {"exponent": chosen.stiffening_exponent.value},
    }
    for effect, said in every.items():
        if effect in effects:
            _fill(effects[effect], said, f"effects.{effect}", name, origins)


def _wall(chosen: Tissue) -> dict[str, Any]:
    return {
        "thickness_m": chosen.thickness_m.value,
        "youngs_modulus_pa": chosen.axial_modulus_pa.value,
        "poisson_ratio": chosen.major_poisson_ratio.value,
        "density_kg_m3": chosen.density_kg_m3.value,
    }


def _anisotropy(chosen: Tissue) -> dict[str, Any]:
    ratios = ("modulus_ratio", "shear_modulus_ratio")
    return {**{ratio: getattr(chosen, ratio) for ratio in ratios}, "poisson_ratio": chosen.axial_poisson_ratio}


def _viscoelasticity(chosen: Tissue) -> dict[str, Any]:
    series = chosen.prony_series()
    return {"g": list(series.g), "tau_s": list(series.tau_s)}


def _fill(part: Any, said: dict[str, Any], path: str, name: str, origins: config.Origins) -> None:
    """Add what is not there to a part of the file; what is no mapping is left to the check that follows."""
    if not isinstance(part, dict):
        return
    for key in said.keys() - part.keys():
        part[key] = said[key]
        origins[f"{path}.{key}"] = f"tissue {name}"
