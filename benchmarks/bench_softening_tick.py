"""What a wall that gives way adds to a tick of the insertion, and of one whose steadying hand squeezes the duct.

python benchmarks/bench_softening_tick.py    # two minutes, and one more where the law is not in the cache yet

Three simulations, with `softening`, without, and without once more, take every tick one after the other, in an order
that turns. What it adds is the median of the differences tick by tick, noise the same of the two that are alike.
At most 80 us were asked.
"""

from __future__ import annotations

import os

# Before numpy is loaded: sums are taken in one order.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import replace

import numpy as np
from report import Row, write_report

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scenarios import PlayedScene, insertion
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.effect_costs import time_in_turns

MOST_US = 80.0
SHUT_RAD = 0.45
"""Of the steadying jaws, where the insertion has 0.8: the wall between them is folded to half its width."""


def squeezing() -> PlayedScene:
    """The insertion, whose other hand squeezes the duct instead of steadying it."""
    hands = insertion()
    pushing, steadying = hands.motions
    if steadying is None:
        raise ValueError("the insertion has two hands")
    angles = (*steadying.jaw_angle_rad[:-1], SHUT_RAD)
    return replace(hands, name="squeezing", motions=(pushing, replace(steadying, jaw_angle_rad=angles)))


def rows(hands: PlayedScene, beside: tuple[str, ...] = ()) -> list[Row]:
    """What it adds beside the scene's own effects and some others."""
    scene = hands.scene
    others = {name: EFFECTS[name].kind.Settings() for name in beside}
    bare = replace(scene, effects={**scene.effects, **others})
    soft = replace(bare, effects={**bare.effects, "softening": EFFECTS["softening"].kind.Settings()})
    directory = cache_directory() / "bases"
    simulations = [Simulation(each, build_scene_duct(each, directory)) for each in (soft, bare, bare)]
    with_it, without, again = time_in_turns(simulations, hands)
    added = with_it - without
    name = " and ".join([hands.name, *beside])
    noise = abs(float(np.median(again - without)))
    slow, slow_noise = (_p99(times) - _p99(without) for times in (with_it, again))
    return [
        Row(f"{name}: added to a tick", float(np.median(added)), "us", MOST_US, note=f"noise {noise:.1f} us"),
        Row(f"{name}: added at the 99th percentile", slow, "us", note=f"noise {abs(slow_noise):.0f} us"),
        Row(f"{name}: tick with it", float(np.median(with_it)), "us", p99=_p99(with_it)),
        Row(f"{name}: tick without", float(np.median(without)), "us", p99=_p99(without)),
    ]


def _p99(times_us: np.ndarray) -> float:
    return float(np.percentile(times_us, 99))


def main() -> None:
    """Measure, and write the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    measured = [*rows(insertion()), *rows(squeezing()), *rows(squeezing(), ("viscoelasticity",))]
    write_report("softening_tick", "What a wall that gives way costs in a tick", measured)


if __name__ == "__main__":
    main()
