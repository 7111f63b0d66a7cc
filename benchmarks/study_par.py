"""Par of the scenarios: ``python -m benchmarks.study_par``, six minutes of a core.

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
from trocar.services.training.scenario import load_scenario, scenario_names

SPREAD = 0.25
"""Pace, stiffness and friction are drawn so far to either side of what the files say."""
WITHIN = 0.1, 1e-3
"""A figure is as par says it within this share of par and this much (SI), as in the test of the scenarios."""
UNITS = {"_s": ("s", 1.0), "_m": ("mm", 1e3), "_n": ("mN", 1e3)}
_COEFFICIENTS = "mu_static", "mu_kinetic"
NOTES = """The value is what hands reach in the scenario as it is, at the pace of the stub rig, by which its file's par
is set. Beside it: par, and least, median and most over {seeds} seeds with hands at 0.15 to 0.25 of their script's speed
(the stub rig's is 0.2) and modulus and wall friction of the catheter up to a quarter off. A seed keeps to par if its
figure is at most par and a tenth, or a millimetre or millinewton more; the time is par's at the stub rig's pace, and
grows as hands are slower. A seed whose hands do not reach the goal, or err critically, is counted as failed. The
scenario `mirrored` is to the mechanics the same as `basic`.
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
    rows: list[Row] = []
    with pytest.MonkeyPatch.context() as patch:
        be_patient(patch)
        for name in scenario_names():
            if name != "mirrored":
                rows += _rows(name, seeds)
    write_report("par", "Par of the scenarios", rows, NOTES.format(seeds=seeds))


def _rows(name: str, seeds: int) -> list[Row]:
    """Return what hands reach in a scenario, a row for each figure of its par."""
    scenario = load_scenario(name)
    own = attempt_of_hands(scenario)
    found = [drawn(name, seed) for seed in range(seeds)]
    good = [each for each in found if each.outcome == "success" and not _critical(each)]
    rows = [_row(name, key, par, own, good) for key, par in scenario.par.items()]
    rows.append(Row(f"{name}, failed", float(seeds - len(good)), "", note=f"of {seeds} seeds"))
    for row in rows:
        print(row.name, f"{row.value:.4g}", row.note, own.outcome, flush=True)
    return rows


def _row(name: str, key: str, par: float, own: Assessment, good: list[Assessment]) -> Row:
    unit, scale = UNITS.get(key[-2:], ("", 1.0))
    values = np.array([each.metrics[key] for each in good])
    note = f"par {scale * par:.4g}"
    if good:
        note += "; {:.3g}, {:.3g}, {:.3g}".format(*scale * np.quantile(values, (0.0, 0.5, 1.0)))
        share, least = WITHIN
        note += f"; {np.sum(values <= par + max(share * par, least))} of {len(good)} keep to it"
    return Row(f"{name}, {key}", scale * own.metrics[key], unit, note=note)


def _critical(found: Assessment) -> bool:
    return any(error.severity == "critical" for error in found.errors)


if __name__ == "__main__":
    main()
