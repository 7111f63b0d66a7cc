"""The mechanics broken a little, as a change may break it without meaning to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace

from trocar.services.mechanics.effects.friction import FrictionSettings

from .cases import Case


def softer_wall(case: Case) -> Case:
    """The wall's modes are softer by 1 %."""
    basis = replace(case.duct.basis, omega_rad_s=case.duct.basis.omega_rad_s * 0.99**0.5)
    return replace(case, duct=replace(case.duct, basis=basis))


def less_damping(case: Case) -> Case:
    """The wall's modes are damped by 10 % less."""
    return replace(case, duct=replace(case.duct, damping_ratio=0.9 * case.duct.damping_ratio))


def no_damping(case: Case) -> Case:
    """Nobody damps the wall's modes."""
    return replace(case, duct=replace(case.duct, damping_ratio=0.0 * case.duct.damping_ratio))


def more_friction(case: Case) -> Case:
    """Everything rubs by 5 % more."""
    settings = case.scene.effects["friction"]
    assert isinstance(settings, FrictionSettings)
    more = FrictionSettings(*(1.05 * each for each in astuple(settings)))
    return replace(case, scene=replace(case.scene, effects={**case.scene.effects, "friction": more}))


def softer_catheter(case: Case) -> Case:
    """The catheter is softer by 1 %."""
    catheter = case.scene.catheter
    softer = replace(catheter, youngs_modulus_pa=0.99 * catheter.youngs_modulus_pa)
    return replace(case, scene=replace(case.scene, catheter=softer))


BREAKS: dict[str, Callable[[Case], Case]] = {
    each.__name__: each for each in (softer_wall, less_damping, no_damping, more_friction, softer_catheter)
}
