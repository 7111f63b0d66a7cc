"""Drawn patients: cystic ducts by their anatomy, with folds and the common duct, under hands that cross and squeeze.

The hands are those of the family in which everything is drawn; the duct, its wall and its folds are drawn within the
ranges of `trocar.services.mechanics.scene.cystic_duct`, and the catheter is one of those as sold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.anatomy.catheter_choice import CATHETERS
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.meshes.branching import load_branching
from trocar.services.runtime.config.products import load_product
from trocar.studies.cystic_folds import BENT_TIP, TRACTION_N, drawn_duct
from trocar.studies.stability.crossing import crossing_hands
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, log_uniform, played
from trocar.studies.stability.situations import approaching, with_catheter

COUNT, QUICK_COUNT = 60, 4
SEEDS = 2**31
BESIDE = "gravity", "friction", "grasp_slip", "twist", "mucus_drag", "viscoelasticity"
"""Effects that training with a patient's duct calls for; each is there by the toss of a coin."""


def cases(draw: Draw) -> Iterator[Case]:
    """So many patients as were asked for, each drawn anew."""
    for k in range(draw.cases or (COUNT if draw.is_long else QUICK_COUNT)):
        yield played(f"patient {k}", partial(_play, draw, k))


def drawn_patient(random: np.random.Generator) -> SceneModel:
    """Return a patient with a wall of 0.5 to 1.5 mm and 100 kPa to 1 MPa, and a catheter with a bent tip or without.

    Ducts, bent tip and traction are those of the study of folds.
    """
    duct = drawn_wall(random)
    while not _is_possible(duct):
        duct = drawn_wall(random)
    tossed = [name for name in BESIDE if random.random() < 0.5]
    tip = (BENT_TIP,) if random.random() < 0.5 else ()
    called_for = [*tossed, "twist"] if tip and "twist" not in tossed else tossed  # a bent tip turns with the material
    effects = {name: EFFECTS[name].kind.Settings() for name in called_for}
    scene = replace(approaching().scene, duct=duct, effects=effects)
    return with_catheter(scene, **_catheter(random), sections=tip, before_mouth_m=2e-3)


def drawn_wall(random: np.random.Generator) -> DuctScene:
    """Return a duct of a drawn seed with a drawn wall, which may be too thick for its course."""
    return DuctScene(
        cystic=drawn_duct(int(random.integers(SEEDS))),
        thickness_m=random.uniform(0.5e-3, 1.5e-3),
        youngs_modulus_pa=log_uniform(random, 100e3, 1e6),
        n_modes=60,
        traction_n=float(random.choice([0.0, TRACTION_N])),
    )


def _is_possible(duct: DuctScene) -> bool:
    """Return whether there is such a duct: a wall that is too thick for a narrow course folds onto itself."""
    try:
        duct_tubes(duct)
    except ValueError:
        return False
    return True


def _catheter(random: np.random.Generator) -> dict[str, float]:
    """Return the numbers of a catheter as sold. Each of them passes every width that is drawn."""
    product = load_product(str(random.choice(CATHETERS)))
    return {key: value.value for key, value in product.values.items()}


def _play(draw: Draw, k: int) -> Play:
    random = draw.random(f"patient {k}")
    scene = drawn_patient(random)
    tubes = duct_tubes(scene.duct)
    mesh = load_branching(tubes, None)
    mouth, trunk = mouth_opening(mesh), tubes[0]
    at_m = random.uniform(0.1, 0.9) * trunk.length_m
    before_m = mouth.centre_m - random.uniform(5e-3, 26e-3) * mouth.inward
    hands = crossing_hands(random, scene, (before_m, trunk.place(at_m)[0]), trunk.radius_at(at_m) + 6e-3)
    return Play(scene=scene, hands=hands, mesh=mesh, times_ticks=True)
