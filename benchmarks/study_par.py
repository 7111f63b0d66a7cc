"""Par of the procedures: ``python -m benchmarks.study_par``, a quarter of an hour of a core.

What simulated hands need for each scenario at the pace of the stub rig, and over seeds: of hands that are slower and
faster, in scenes whose catheter and friction are other than the file says. Writes benchmarks/results/par.md.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.report import Row, parse, write_report
from tests.training.hands_attempt import PACE, attempt_of_hands
from tests.training.simulated import be_patient
from trocar.review.attempts.assessment import Assessment
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.scenes import load_scene
from trocar.services.training.scenario import load_scenario

PROCEDURES = {
    "bile duct": "basic",
    "aortic arch": "endovascular",
    "guide wire": "guide-wire",
    "bronchi": "bronchoscopy",
}
SPREAD = 0.25
"""Pace, stiffness and friction are drawn so far to either side of what the files say."""
FIGURES = {"time_s": ("s", 1.0), "tip.path_m": ("mm", 1e3), "catheter_wall.peak_n": ("mN", 1e3)}
_COEFFICIENTS = "mu_static", "mu_kinetic"
NOTES = """Each scenario as it is (the value: its file's par), and over {seeds} seeds (least, median, most) with hands
at 0.15 to 0.25 of their script's speed, and modulus and wall friction of the catheter up to a quarter off. A seed
whose hands do not reach the goal, or err critically, is counted as failed.
"""


def drawn(scenario: str, seed: int) -> Assessment:
    """Return what hands of this seed reach."""
    random = np.random.default_rng(seed)
    loaded = load_scenario(scenario)
    scene = load_scene(loaded.scene, loaded.set)
    pace, stiffness, friction = random.uniform(1.0 - SPREAD, 1.0 + SPREAD, 3).tolist()
    overrides = [f"catheter.youngs_modulus_pa={stiffness * scene.catheter.youngs_modulus_pa!r}"]
    if isinstance(rubs := scene.effects.get("friction"), FrictionSettings):
        overrides += [f"effects.friction.{name}={friction * getattr(rubs, name)!r}" for name in _COEFFICIENTS]
    return attempt_of_hands(loaded, overrides, pace * PACE)


def main() -> None:
    """Let the hands try, and write the table."""
    seeds = parse(__doc__, seeds=(5, "of each scenario")).seeds
    rows = []
    with pytest.MonkeyPatch.context() as patch:
        be_patient(patch)
        for procedure, scenario in PROCEDURES.items():
            own = attempt_of_hands(load_scenario(scenario))
            found = [drawn(scenario, seed) for seed in range(seeds)]
            good = [each for each in found if each.outcome == "success" and not _critical(each)]
            for name, (unit, scale) in FIGURES.items():
                values = scale * np.array([each.metrics[name] for each in good])
                note = "{:.3g}, {:.3g}, {:.3g}".format(*np.quantile(values, (0.0, 0.5, 1.0))) if good else ""
                note += f"; {seeds - len(good)} of {seeds} failed"
                rows.append(Row(f"{procedure}, {name}", scale * own.metrics[name], unit, note=note))
                print(rows[-1].name, f"{rows[-1].value:.4g}", note, own.outcome, flush=True)
    write_report("par", "Par of the procedures", rows, NOTES.format(seeds=seeds))


def _critical(found: Assessment) -> bool:
    return any(error.severity == "critical" for error in found.errors)


if __name__ == "__main__":
    main()
