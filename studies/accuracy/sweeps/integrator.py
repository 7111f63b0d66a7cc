"""How duct and catheter are integrated in time: free motions, away from any contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.rod import ImplicitIntegrator, RodState, SemiImplicitIntegrator, clamped
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.studies.accuracy import pinches
from trocar.studies.accuracy.study import Choice, Draw, Error, Reference, Setting, Tick
from trocar.studies.full_model import rayleigh_damping_ratio
from trocar.studies.published.rod_dynamics import CATHETER_DAMPING_S, bent_by_tip_load, released_tip
from trocar.studies.published.rods import X, example_rod

TITLE = "Integration in time"
WHAT = (
    "Free motions, without contact. The catheter is bent by 17 mm and released. It is integrated by the implicit step "
    "with several spectral radii (1 keeps motion that is too fast for the step, 0 damps it away), and by the paper's "
    "semi-implicit Euler with as many substeps as it needs; the reference is the midpoint rule at 10 us. The duct "
    "moves after a push, by Newmark and by the exact oscillator; the reference is the exact one in a hundredth of a "
    "step. The cost is that of the one body."
)
RELEASED = "released catheter"
TICK_S = 1e-3
_ROD, _DUCT = "catheter", "duct"


def settings(draw: Draw) -> Sequence[Setting]:
    """Both bodies, each with its integrators and some lengths of the step."""
    radii = draw.pick((0.6,), (0.0, 0.6, 1.0), (0.0, 0.3, 0.6, 0.8, 1.0))
    steps = draw.pick((1,), (1, 2), (1, 2, 4, 8))
    rods = [
        Setting(
            f"implicit, radius {radius:g}, {1.0 / n:g} ms",
            {"catheter.integrator": "implicit", "catheter.spectral_radius": radius, "dt_s": TICK_S / n},
            "catheter, implicit",
        )
        for radius in radii
        for n in steps
    ]
    explicit: dict[str, Choice] = {"catheter.integrator": "semi_implicit", "dt_s": TICK_S}
    ducts = [
        Setting(f"{kind}, {1.0 / n:g} ms", {"duct.integrator": kind, "dt_s": TICK_S / n}, f"duct, {kind}")
        for kind in ("newmark", "exact")
        for n in steps
    ]
    return [*rods, Setting("semi-implicit", explicit, "catheter, semi-implicit"), *ducts]


def reference(draw: Draw) -> Reference:
    """Return both motions in very short steps."""
    bent_m = bent_by_tip_load()
    tip_m = released_tip(bent_m, draw.pick(1e-4, 1e-5, 1e-5), 1.0, duration_s=_followed_s(draw))
    return {"bent_m": bent_m, "tip_m": tip_m, "closing_m": _pushed(TICK_S / 100.0, is_exact=True)}


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """That of the one body that the setting is about."""
    dt_s = float(setting.choices["dt_s"])
    if "duct.integrator" in setting.choices:
        moved_m = _pushed(dt_s, is_exact=setting.choices["duct.integrator"] == "exact")
        return {pinches.MOTION: pinches.motion_error(moved_m, reference["closing_m"])}
    if setting.choices["catheter.integrator"] == "implicit":
        radius = float(setting.choices["catheter.spectral_radius"])
        tip_m = released_tip(reference["bent_m"], dt_s, radius, duration_s=_followed_s(draw))
    else:
        tip_m = _released_semi_implicit(reference["bent_m"], _followed_s(draw))
    return {RELEASED: Error(1e3 * float(np.sqrt(np.mean(np.sum((tip_m - reference["tip_m"]) ** 2, axis=1)))), "mm")}


def tick(setting: Setting, draw: Draw) -> Tick:
    """A millisecond of the body's own motion."""
    dt_s = float(setting.choices["dt_s"])
    per_tick = round(TICK_S / dt_s)
    if "duct.integrator" in setting.choices:
        return _duct_tick(dt_s, per_tick, is_exact=setting.choices["duct.integrator"] == "exact")
    rod = _rod(setting)
    bent_m = bent_by_tip_load()
    state, no_load = RodState(bent_m, np.zeros_like(bent_m)), np.zeros_like(bent_m)

    def step() -> None:
        for _ in range(per_tick):
            rod.predict(state, no_load, dt_s)

    return step


def _rod(setting: Setting) -> ImplicitIntegrator | SemiImplicitIntegrator:
    properties = example_rod(internal_damping_s=CATHETER_DAMPING_S)
    if setting.choices["catheter.integrator"] == "implicit":
        radius = float(setting.choices["catheter.spectral_radius"])
        return ImplicitIntegrator(properties, clamped(X), spectral_radius=radius)
    return _semi_implicit()


def _semi_implicit() -> SemiImplicitIntegrator:
    """As the paper has it: internal damping would shorten its step below use."""
    return SemiImplicitIntegrator(example_rod(), clamped(X))


def _released_semi_implicit(bent_m: FloatArray, followed_s: float) -> FloatArray:
    rod, state, no_load = _semi_implicit(), RodState(bent_m.copy(), np.zeros_like(bent_m)), np.zeros_like(bent_m)
    tip_m = np.empty((round(followed_s / TICK_S), 3))
    for row in tip_m:
        rod.predict(state, no_load, TICK_S)
        row[:] = state.position_m[-1]
    return tip_m


def _followed_s(draw: Draw) -> float:
    return draw.pick(0.05, 0.3, 0.3)


def _pushed(dt_s: float, *, is_exact: bool) -> FloatArray:
    scene = insertion_scene()
    duct = pinches.reduced(scene.duct)
    return pinches.modal_motion_m(duct, pinches.Pinch.of(duct.mesh, scene.duct), dt_s, TICK_S, is_exact=is_exact)


def _duct_tick(dt_s: float, per_tick: int, *, is_exact: bool) -> Tick:
    basis = pinches.reduced(insertion_scene().duct).basis
    damping = rayleigh_damping_ratio(basis.omega_rad_s, pinches.ALPHA_1_S, pinches.BETA_S)
    integrator = (ExactOscillator if is_exact else Newmark)(basis.omega_rad_s, damping)
    state, force = ModalState.at_rest(basis.n_modes), np.full(basis.n_modes, 1e-3)

    def step() -> None:
        for _ in range(per_tick):
            integrator.predict(state, force, dt_s)

    return step
