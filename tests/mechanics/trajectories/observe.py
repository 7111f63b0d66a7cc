"""What a run is known by: a checksum of every state and force of each tick, and a few numbers that mean something."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation

from .cases import DT_S, TICKS, Case

FloatArray = npt.NDArray[np.float64]
State = dict[str, npt.NDArray[np.generic]]

N_WALL_NODES = 24


@dataclass
class Run:
    """A run.

    Attributes
    ----------
    checksum : (T,) uint64
        Of all bits of all states and forces after each tick.
    figures : dict of str to (T,) float64
        Quantities that do not depend on the signs and the order of the modes.
    """

    checksum: npt.NDArray[np.uint64]
    figures: dict[str, FloatArray]


@dataclass
class Wall:
    """The nodes of the wall that are looked at: their modes (w, 3, r) and places at rest (w, 3)."""

    modes: FloatArray
    rest_m: FloatArray

    @classmethod
    def of(cls, case: Case) -> Wall:
        """Choose nodes that lie evenly in the mesh's order."""
        nodes = np.linspace(0, case.duct.mesh.n_vertices - 1, N_WALL_NODES).astype(np.int64)
        return cls(np.ascontiguousarray(case.duct.basis.Phi[nodes]), case.duct.mesh.vertices_m[nodes])


def observe(simulation: Simulation, wall: Wall) -> State:
    """Return copies of every state and force after a step."""
    duct, catheter, felt = simulation.duct.state, simulation.catheter.state, simulation.tool_results
    seen: State = {
        "modal_q": duct.q,
        "modal_qdot": duct.qdot,
        "modal_qddot": duct.qddot,
        "wall_m": wall.rest_m + wall.modes @ duct.q,
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


def figures(simulation: Simulation, wall: Wall, seen: State) -> dict[str, float]:
    """Return the numbers of one tick: where everything is, how it moves, what it bears."""
    duct, tip = simulation.duct, seen["catheter_m"][-1]
    found = {
        "wall_m": _mean_norm(seen["wall_m"] - wall.rest_m),
        "strain_j": duct.strain_energy_j(),
        "kinetic_j": duct.kinetic_energy_j(),
        "contacts": len(seen["contact_force_n"]),
        "contact_n": _norms(seen["contact_force_n"]).sum(),
        **{f"tool{k}_n": norm for k, norm in enumerate(_norms(seen["tool_force_n"]))},
        **{f"jaw{k}_nm": torque for k, torque in enumerate(seen["grasp_torque_nm"])},
        **{f"proxy{k}_m": _norms(each[None])[0] for k, each in enumerate(seen["proxy_m"])},
        **{f"tip_{axis}_m": place for axis, place in zip("xyz", tip, strict=True)},
        "catheter_m_s": _mean_norm(seen["catheter_m_s"]),
        "inserted_m": seen["inserted_m"][0],
    }
    if "twist_rad" in seen:
        found["twist_rad"] = np.abs(seen["twist_rad"]).mean()
    if "stone_m" in seen:
        found["stone_x_m"] = seen["stone_m"].reshape(-1, 3)[:, 0].mean()
    return {name: float(value) for name, value in found.items()}


def _norms(vectors: npt.NDArray[np.generic]) -> FloatArray:
    return np.linalg.norm(np.asarray(vectors, np.float64).reshape(-1, 3), axis=1)


def _mean_norm(vectors: npt.NDArray[np.generic]) -> float:
    return float(_norms(vectors).mean())


def run(case: Case, ticks: int = TICKS, jiggle: np.random.Generator | None = None, start: float = 0.0) -> Run:
    """Step a case through its ticks.

    Parameters
    ----------
    jiggle
        Moves the state by about a rounding error before every step.
    start
        By what share of its place the catheter begins elsewhere.
    """
    simulation, tools, wall = Simulation(case.scene, case.duct), ToolInputs(), Wall.of(case)
    simulation.catheter.state.position_m *= 1.0 + start
    checksum, rows = np.zeros(ticks, np.uint64), []
    for tick in range(ticks):
        case.move(tick, tools)
        if jiggle is not None:
            _jiggle(simulation, jiggle)
        simulation.step(tools, dt_s=DT_S)
        seen = observe(simulation, wall)
        checksum[tick] = _checksum(seen)
        rows.append(figures(simulation, wall, seen))
    return Run(checksum, {name: np.array([row.get(name, 0.0) for row in rows]) for name in rows[-1]})


def first_difference(one: Run, other: Run) -> int | None:
    """Return the first tick in which any bit of any state or force differs, None if none does."""
    differs = np.flatnonzero(one.checksum != other.checksum)
    return int(differs[0]) if differs.size else None


def _checksum(seen: State) -> int:
    """Return 64 bits that tell whether anything at all is different; -0.0 counts as 0.0."""
    digest = hashlib.blake2b(digest_size=8)
    for values in seen.values():
        digest.update((values + np.zeros((), values.dtype)).tobytes())
    return int.from_bytes(digest.digest(), "little")


def _jiggle(simulation: Simulation, random: np.random.Generator) -> None:
    for state in (simulation.duct.state.q, simulation.catheter.state.position_m):
        state *= 1.0 + 2.0**-52 * random.integers(-1, 2, state.shape)
