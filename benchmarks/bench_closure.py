"""Jaws that shut altogether on the wall of a scene, and open: does the hand feel the moment of the wall's forces?

python benchmarks/bench_closure.py default --set effects.softening={}
python benchmarks/bench_closure.py anatomy --set duct.mesh_file=surface.stl --set effects.softening={}

The scene's second tool takes the duct where its hands steady it, shuts within half a second, stays so, and opens. Said
are: the torque at the handle beside the moment of all forces on the jaws, by virtual work from the contacts' places;
the largest change of the hand's force and torque in a tick; and what the energy book misses of what hands put in.
"""

from __future__ import annotations

import os

# Before numpy is loaded: sums are taken in one order.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scenarios import PlayedScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of
from trocar.services.scenes.ready import load_surface
from trocar.studies.energy_book import EnergyBook
from trocar.studies.jaw_moment import JawMoment

TOOL, TICKS = 1, 1700
TIMES_S = 0.0, 0.3, 0.4, 0.9, 1.2, 1.6
"""Above, there, begins to shut, is shut, begins to open, is open."""
PRESSED_NM = 1e-3
"""Torque from which on a handle is compared."""


def closure(scenario: PlayedScene, simulation: Simulation) -> dict[str, float]:
    """Play it; returns what is told, by what it is and in which unit."""
    tools, felt = ToolInputs(), np.zeros((TICKS, 5))
    scenario.write_inputs(0.0, tools)
    simulation.step(tools)
    book, put_in_j = EnergyBook(simulation), 0.0
    for tick in range(TICKS):
        scenario.write_inputs(1e-3 * (tick + 1), tools)
        moment = JawMoment(simulation, TOOL)
        book.step(tools)
        results = simulation.tool_results
        felt[tick] = *results.force_n[TOOL], results.grasp_torque_nm[TOOL], moment.after_step_nm()
        put_in_j = max(put_in_j, book.flow.input_j)
    return {**_told(felt), "energy put in, mJ": 1e3 * put_in_j, "missed by the book": book.flow.imbalance_j / put_in_j}


def _told(felt: FloatArray) -> dict[str, float]:
    torque, moment = felt[:, 3], felt[:, 4]
    pressed = torque > PRESSED_NM
    change = np.abs(np.diff(felt, axis=0))
    return {
        "ticks in which the jaws press": float(pressed.sum()),
        "torque when shut, mN m": 1e3 * float(torque.max()),
        "torque off the moment, largest part": float(np.max(np.abs(torque - moment)[pressed] / torque[pressed])),
        "largest change of force in a tick, N": float(np.linalg.norm(change[:, :3], axis=1).max()),
        "largest change of torque in a tick, mN m": 1e3 * float(change[:, 3].max()),
    }


def main() -> None:
    """Play the scene that the command line names, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    cache = cache_directory()
    scene = load_scene(given.scene, given.set)
    mesh = load_surface(scene, cache)
    scene = place_catheter(scene, mesh)
    hand = hands_of(replace(scene, hands="insertion"), mesh).motions[TOOL]
    if hand is None:
        raise SystemExit(f"{given.scene}: the jaws of forceps.{TOOL} do not open over the duct")
    (above, at, _), (wide, _, _), roll = hand.grip_point_m, hand.jaw_angle_rad, hand.roll_rad[0]
    points, openings = (above, *(at,) * 5), (wide, wide, wide, 0.0, 0.0, wide)
    motion = replace(hand, time_s=TIMES_S, grip_point_m=points, jaw_angle_rad=openings, roll_rad=(roll,) * 6)
    scenario = PlayedScene("closure", "jaws shut on the wall", 1e-3 * TICKS, scene, (None, motion))
    duct = load_duct(scene, cache, lambda stage, part: None)
    for what, value in closure(scenario, Simulation(scene, duct)).items():
        print(f"{what}: {value:.3g}")


if __name__ == "__main__":
    main()
