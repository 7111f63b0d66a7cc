"""What a run is known by: every state and every force of each of its ticks."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import dataclass, field
from importlib.metadata import version

import llvmlite.binding as llvm
import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation

from .cases import DT_S, TICKS, Case

FloatArray = npt.NDArray[np.float64]

N_WALL_NODES = 24
# What one unit of a stored number means: far below what is seen (0.1 mm) or felt (1 mN).
QUANTA = {
    "modal_q": 1e-9,
    "modal_qdot": 1e-6,
    "modal_qddot": 1e-3,
    "wall_m": 1e-9,
    "load_force_n": 1e-7,
    "catheter_m": 1e-9,
    "catheter_m_s": 1e-6,
    "director": 1e-7,
    "twist_rad": 1e-7,
    "stone_m": 1e-9,
    "stone_m_s": 1e-6,
    "contact_force_n": 1e-7,
    "tool_force_n": 1e-7,
    "port_moment_nm": 1e-9,
    "grasp_torque_nm": 1e-9,
    "stiffness_n_m": 1e-3,
    "proxy_m": 1e-9,
    "proxy_jaw_rad": 1e-8,
    "inserted_m": 1e-9,
}
# The number of rows of these differs from tick to tick.
RAGGED = ("load_node", "load_force_n", "contact_force_n")


@dataclass
class Run:
    """A run: for every tick a checksum of all bits, and of every quantity its values.

    Attributes
    ----------
    checksum : (T,) uint64
    values : dict of str to (T, ...)
        Ragged quantities are laid one behind the other; ``counts`` says how many rows belong to each tick.
    """

    checksum: npt.NDArray[np.uint64]
    values: dict[str, npt.NDArray[np.generic]]
    counts: dict[str, npt.NDArray[np.int64]] = field(default_factory=dict)


def observe(simulation: Simulation, wall: FloatArray, rest: FloatArray) -> dict[str, npt.NDArray[np.generic]]:
    """Return copies of every state and force after a step; ``wall`` (w, 3, r) are the modes at its nodes ``rest``."""
    duct, catheter, felt = simulation.duct.state, simulation.catheter.state, simulation.tool_results
    seen: dict[str, npt.NDArray[np.generic]] = {
        "modal_q": duct.q,
        "modal_qdot": duct.qdot,
        "modal_qddot": duct.qddot,
        "wall_m": rest + wall @ duct.q,
        "load_node": simulation.duct.load_nodes[: simulation.duct.n_loads],
        "load_force_n": simulation.duct.load_force_n[: simulation.duct.n_loads],
        "catheter_m": catheter.position_m,
        "catheter_m_s": catheter.velocity_m_s,
        "contact_force_n": simulation.contact_force_n,
        "tool_force_n": felt.force_n,
        "port_moment_nm": felt.port_moment_nm,
        "grasp_torque_nm": felt.grasp_torque_nm,
        "stiffness_n_m": felt.stiffness_n_m,
        "proxy_m": felt.proxy_position_m,
        "proxy_jaw_rad": felt.proxy_jaw_angle_rad,
        "inserted_m": np.array([simulation.inserted_length_m]),
    }
    if catheter.frame is not None:
        seen["director"], seen["twist_rad"] = catheter.frame.m1, catheter.frame.twist_rad
    if "gallstones" in simulation.effects:
        stones = simulation.effects["gallstones"]
        seen["stone_m"], seen["stone_m_s"] = stones.position_m, stones.velocity_m_s  # type: ignore[attr-defined]
    return {name: np.array(values) for name, values in seen.items()}


def run(case: Case, jiggle: np.random.Generator | None = None) -> Run:
    """Step a case through its ticks; ``jiggle`` moves its state by about a rounding error before every step."""
    simulation, tools = Simulation(case.scene, case.duct), ToolInputs()
    nodes = np.linspace(0, case.duct.mesh.n_vertices - 1, N_WALL_NODES).astype(np.int64)
    wall, rest = np.ascontiguousarray(case.duct.basis.Phi[nodes]), case.duct.mesh.vertices_m[nodes]
    checksum, seen = np.zeros(TICKS, np.uint64), []
    for tick in range(TICKS):
        case.move(tick, tools)
        if jiggle is not None:
            _jiggle(simulation, jiggle)
        simulation.step(tools, dt_s=DT_S)
        seen.append(observe(simulation, wall, rest))
        checksum[tick] = _checksum(seen[-1])
    values = {name: _stack([one[name] for one in seen], name) for name in seen[-1]}
    counts = {name: np.array([len(one[name]) for one in seen]) for name in RAGGED}
    return Run(checksum, values, counts)


def _stack(rows: list[npt.NDArray[np.generic]], name: str) -> npt.NDArray[np.generic]:
    if name in RAGGED:
        return np.concatenate(rows)
    return np.stack([np.zeros_like(rows[-1]) if row.shape != rows[-1].shape else row for row in rows])


def _checksum(seen: dict[str, npt.NDArray[np.generic]]) -> int:
    """Return 64 bits that tell whether anything at all is different; -0.0 counts as 0.0."""
    digest = hashlib.blake2b(digest_size=8)
    for values in seen.values():
        digest.update((values + np.zeros((), values.dtype)).tobytes())
    return int.from_bytes(digest.digest(), "little")


def _jiggle(simulation: Simulation, random: np.random.Generator) -> None:
    for state in (simulation.duct.state.q, simulation.catheter.state.position_m):
        state *= 1.0 + 2.0**-52 * random.integers(-1, 2, state.shape)


def machine() -> str:
    """Name the kind of machine that gives the same bits: processor, features that LLVM uses, numerical packages."""
    features = ",".join(sorted(name for name, has in llvm.get_host_cpu_features().items() if has))
    kind = hashlib.blake2b(features.encode(), digest_size=4).hexdigest()
    packages = " ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "llvmlite"))
    return f"{llvm.get_host_cpu_name()} {kind} {platform.system()} {packages}"
