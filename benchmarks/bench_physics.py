"""The whole physics tick: 1,440-node duct, 100 modes, 50 segments, friction, both tools, 30 pressed contacts.

    OPENBLAS_NUM_THREADS=1 GLIBC_TUNABLES=glibc.malloc.hugetlb=1 python benchmarks/bench_physics.py [--ticks 4000]

That is the environment of the rig's processes; like the rig's physics it runs on a core of its own under SCHED_FIFO
where that is allowed, and is handed the pairs of the tools, which haptics finds; a tick that finds them is given too.
A fixed piece of arithmetic of about a tick's length is the floor: its 99th percentile over its median is the machine's.

Also how much of the catheter the paper's penalty contact lets through the wall there, how much of a tick each stage
takes, the insertion with our set-up and with the paper's, error and cost side by side, and a smaller duct in MuJoCo
where that is installed.
"""

from __future__ import annotations

import argparse
import gc
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from contact_peers import mujoco_duct
from report import Row, Timing, measure, write_report

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.reduction.modal_compliance import add_modal_compliance
from trocar.services.mechanics.scenarios import insertion, insertion_scene
from trocar.services.mechanics.scene import CatheterScene, ContactSettings, DuctScene, ForcepsScene, SceneModel
from trocar.services.mechanics.scene.duct_recipe import duct_recipe
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, scene_mesh
from trocar.services.runtime.realtime import realtime
from trocar.services.runtime.realtime.realtime import Fact
from trocar.studies.paper_scene import paper_scene
from trocar.studies.stability.crossings import count_crossings

CORE, PRIORITY = 1, 60  # of physics in configs/rigs/stub.yaml
TICK_BUDGET_S = 250e-6
SLEEPING_S = 1e-6


def loaded_scene() -> SceneModel:
    """A soft catheter pressed along the floor of a long duct by twice its weight, a tool on the duct."""
    return SceneModel(
        duct=DuctScene(length_m=76e-3, n_around=36, n_along=39, n_modes=100, thickness_m=1e-3, youngs_modulus_pa=3e6),
        catheter=CatheterScene(
            youngs_modulus_pa=2e5, tip_position_m=(2e-3, 0.0, -2.66e-3), anchor="free", viscous_drag_n_s_m2=0.5
        ),
        forceps=(
            ForcepsScene(port_position_m=(30e-3, 0.0, 0.15)),
            ForcepsScene(port_position_m=(90e-3, 0.0, 0.15)),
        ),
        effects={
            "gravity": GravitySettings(acceleration_m_s2=(0.0, 0.0, -20.0)),
            "friction": FrictionSettings(mu_static=0.4, mu_kinetic=0.3),
            "grasp_slip": NoSettings(),
        },
    )


def settle(scene: SceneModel, cache: Path) -> tuple[Simulation, ToolInputs]:
    """Press one tool on the duct from above, rest the other, and wait until all lies still."""
    simulation = Simulation(scene, build_scene_duct(scene, cache))
    tools = ToolInputs()
    for tick in range(500):
        above_m = 3e-3 * max(1.0 - tick / 100.0, 0.0)
        tools.position_m[:] = (30e-3, 0.0, 15e-3 + 5e-3 + above_m), (90e-3, 0.0, 40e-3)
        simulation.step(tools)
    return simulation, tools


def insert(scene: SceneModel, cache: Path) -> tuple[float, float, float]:
    """Let the scripted hands insert the catheter; return deepest penetration in m, length inserted and median tick."""
    hands = insertion()
    simulation, tools = Simulation(scene, build_scene_duct(scene, cache)), ToolInputs()
    deepest, seconds = 0.0, []
    for tick in range(round(1000 * hands.duration_s)):
        hands.write_inputs(1e-3 * tick, tools)
        started = time.perf_counter()
        simulation.step(tools)
        seconds.append(time.perf_counter() - started)
        deepest = max(deepest, simulation.max_penetration_m)
    return deepest, simulation.inserted_length_m, float(np.median(seconds))


def comparison(cache: Path) -> list[Row]:
    """The insertion with our contact and with the paper's set-up, error and cost side by side.

    The paper's scene has its element, bare modes, particles and penalty contact. Both pinch the duct by 1 N at
    the middle; the full model's compliance there is the reference.
    """
    rows = []
    for name, scene in (("ours", insertion_scene()), ("paper", paper_scene())):
        deepest, inserted, median_s = insert(scene, cache)
        rows.append(Row(f"insertion, {name}: deepest penetration", 1e6 * deepest, "um"))
        rows.append(Row(f"insertion, {name}: inserted", 1e3 * inserted, "mm"))
        rows.append(Row(f"insertion, {name}: median tick", 1e6 * median_s, "us"))
        rows.append(Row(f"pinch compliance, {name}: error", 100.0 * pinch_error(scene, cache), "%"))
    return rows


def pinch_error(scene: SceneModel, cache: Path) -> float:
    """Relative error of the static compliance under a pair of opposite forces, against our element in full."""
    duct = build_scene_duct(scene, cache)
    mesh = duct.mesh
    middle = np.argsort(np.linalg.norm(mesh.vertices_m - (20e-3, 0.0, 4e-3), axis=1))[0]
    other = np.argsort(np.linalg.norm(mesh.vertices_m - (20e-3, 0.0, -4e-3), axis=1))[0]
    nodes = np.array([middle, other], np.int32)
    forces = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    q = np.einsum("nar,na->r", duct.basis.Phi[nodes], forces) / duct.basis.omega_rad_s**2
    moved = duct.basis.Phi[nodes] @ q
    duct.residual.apply(nodes, forces, nodes, moved)
    reference = insertion_scene()
    load = np.zeros_like(mesh.vertices_m)
    load[nodes] = forces
    exact = duct_recipe(reference.duct, scene_mesh(reference.duct)).model().solve_static(load).displacement_m
    return abs(float(np.sum(moved * forces) / np.sum(exact * load)) - 1.0)


def peer_rows() -> tuple[list[Row], str]:
    """MuJoCo's duct of a third of our nodes, from the moment at which the catheter lies in it."""
    try:
        name, step, n_contacts = mujoco_duct(20, 25, 50)
    except ImportError as error:
        return [], f"MuJoCo was not timed: {error}."
    counts = []

    def counted() -> None:
        step()
        counts.append(n_contacts())

    timing = measure({name: counted}, samples=150)[name]
    return [Row.from_timing(name, timing, note=f"{np.median(counts):.0f} contacts")], ""


def sample_ticks(simulation: Simulation, tools: ToolInputs, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of each tick and of its stages."""
    seconds, stages = np.zeros(samples), np.zeros((samples, len(simulation.stage_cost_ns)))
    gc.collect()
    gc.disable()
    for sample in range(samples):
        started_ns = time.perf_counter_ns()
        simulation.step(tools)
        seconds[sample] = 1e-9 * (time.perf_counter_ns() - started_ns)
        stages[sample] = [1e-9 * cost_ns for cost_ns in simulation.stage_cost_ns.values()]
    gc.enable()
    return seconds, stages


def sleeping_rows(cache: Path, samples: int) -> list[Row]:
    """What a tick spends on a catheter that hangs still, and on a duct alone at rest: a look at each."""
    scene = loaded_scene()
    gravity = {"gravity": scene.effects["gravity"]}
    hung = CatheterScene(anchor="clamped", tip_position_m=(0.3, 0.0, 0.0), viscous_drag_n_s_m2=0.5)
    scene = replace(scene, catheter=hung, effects=gravity)
    duct, tools = build_scene_duct(scene, cache), ToolInputs()
    tools.present[:] = False
    simulation = Simulation(scene, duct)
    for _ in range(5000):
        simulation.step(tools)
    alone = DuctAlone(replace(scene, duct_alone=True, effects={}), duct)
    for _ in range(3):
        alone.step()
    if not (simulation.catheter.is_asleep() and alone.is_asleep()):
        raise SystemExit("what was to be timed asleep is awake")
    parts = {
        "asleep: the catheter's part of a tick": lambda: simulation.catheter.predict(1e-3),
        "asleep: a tick of a duct alone": alone.step,
    }
    timings = {name: measure({name: part}, samples=samples, inner=20)[name] for name, part in parts.items()}
    return [Row.from_timing(name, timing, SLEEPING_S) for name, timing in timings.items()]


_MODES, _GAIN, _SCRATCH, _W = np.ones((111, 100)), np.ones(100), np.zeros(111 * 100), np.zeros((111, 111))
_EACH = np.arange(37, dtype=np.int32)


def floor() -> None:
    """Sums of products that never leave the first two caches."""
    for _ in range(8):
        add_modal_compliance(_MODES, _GAIN, _SCRATCH, _W, _EACH, 0)


def tick_rows(cache: Path, samples: int) -> tuple[list[Row], list[Fact]]:
    """Return what ticks of several kinds take, and the stages of ours; and what the machine granted for it."""
    scene = loaded_scene()
    penalty = replace(scene, contact=ContactSettings(model="penalty", penalty_stiffness_n_m=3.0))
    ours, tools = settle(scene, cache)
    paper, _ = settle(penalty, cache)
    aside = replace(scene.catheter, tip_position_m=(80e-3, 0.0, 0.0))
    free = Simulation(replace(scene, catheter=aside, effects={}), build_scene_duct(scene, cache))
    absent = ToolInputs()
    absent.present[:] = False
    facts, _ = realtime.set_up(CORE, PRIORITY)
    seconds, stages = sample_ticks(ours, tools, samples)
    # One after the other, not interleaved: each is a process of its own on the rig, and its caches are its own.
    timings = {"tick, pressed contacts": Timing.from_samples(seconds)}
    timings |= measure({"floor: fixed arithmetic": floor}, samples=samples)
    timings |= measure({"tick that finds the tools' pairs itself": lambda: ours.step(tools)}, samples=samples)
    timings |= measure({"tick, nothing touched": lambda: free.step(absent)}, samples=samples)
    pressed = int((ours.contacts.force_n[: ours.contacts.n_contacts, 0] > 0.0).sum())
    note = f"{pressed} pressed of {ours.contacts.n_contacts} candidates, {ours.system.sweeps} sweeps"
    rows = [Row.from_timing(name, timing) for name, timing in timings.items()]
    p99_us = 1e6 * timings["tick, pressed contacts"].p99_s
    rows.insert(1, Row("tick, pressed contacts, 99 %", p99_us, "us", 1e6 * TICK_BUDGET_S, note=note))
    for name, timing in list(timings.items())[:2]:
        rows.append(Row(f"99 % over median, {name}", timing.p99_s / timing.median_s, ""))
    wall_m, triangles = paper.duct.surface_m(), paper.duct.reduced.mesh.triangles
    through = count_crossings(paper.catheter.state.position_m, wall_m, triangles)
    rows.append(Row("segments of the catheter that the paper's penalty contact lets through the wall", through, ""))
    for column, name in enumerate(ours.stage_cost_ns):
        rows.append(Row.from_timing(f"stage {name}", Timing.from_samples(stages[:, column])))
    return rows, facts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=4000, help="of each kind; the 99 %% is of so many")
    parser.add_argument("--ticks-only", action="store_true", help="no insertion, no peers; nothing is written")
    arguments = parser.parse_args()
    cache = cache_directory()
    rows, facts = tick_rows(cache, arguments.ticks)
    rows += sleeping_rows(cache, arguments.ticks)
    if arguments.ticks_only:
        for row in rows:
            print(f"{row.name:60s} {row.value:8.2f} {row.unit}")
        return
    rows += comparison(cache)
    peers, absent = peer_rows()
    had = "; ".join(f"{fact.name}: {fact.had}" for fact in facts)
    write_report("physics", "Whole physics tick", rows + peers, f"{had}. {absent}")


if __name__ == "__main__":
    main()
