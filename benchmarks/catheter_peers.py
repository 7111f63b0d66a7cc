"""The example catheter in other engines, each as a function that advances it by one of that engine's own steps.

A missing package raises ImportError with its name; `pip install pyelastica mujoco` in an environment of their own.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LENGTH_M, RADIUS_M, YOUNGS_MODULUS_PA, DENSITY_KG_M3, POISSON_RATIO = 0.1, 0.75e-3, 1e8, 1100.0, 0.45


@dataclass
class Peer:
    """One step, what it advances, and where the tip is."""

    name: str
    step: Callable[[], object]
    dt_s: float
    tip_m: Callable[[], np.ndarray]


def pyelastica(n_segments: int) -> Peer:
    """Cosserat rod, position Verlet at half of the time of a stretch wave along an element or across the rod.

    Sections that turn against shear keep a step short however long elements are. At the whole of it nothing becomes NaN
    within thousands of steps, but the rod doubles its length.
    """
    import elastica as ea

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        pass

    simulator = Simulator()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of the small inertia of a rod this thin
        rod = ea.CosseratRod.straight_rod(
            n_segments,
            np.zeros(3),
            np.array([1.0, 0.0, 0.0]),
            np.array([0.0, 0.0, 1.0]),
            LENGTH_M,
            RADIUS_M,
            DENSITY_KG_M3,
            youngs_modulus=YOUNGS_MODULUS_PA,
            shear_modulus=YOUNGS_MODULUS_PA / (2.0 * (1.0 + POISSON_RATIO)),
        )
    simulator.append(rod)
    simulator.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -9.81]))
    simulator.finalize()
    stepper = ea.PositionVerlet()
    shortest_m = min(LENGTH_M / n_segments, 2.0 * RADIUS_M)
    dt_s = 0.5 * shortest_m / np.sqrt(YOUNGS_MODULUS_PA / DENSITY_KG_M3)
    time_s = 0.0

    def step() -> None:
        nonlocal time_s
        time_s = stepper.step(simulator, time_s, dt_s)

    return Peer("PyElastica, Cosserat rod, Verlet", step, float(dt_s), lambda: rod.position_collection[:, -1])


def mujoco(n_segments: int) -> Peer:
    """MuJoCo's one-dimensional flex (bending and twist), Newton solver at 1 ms, edges stiffened to solref 0.002."""
    import mujoco as mj

    spacing = LENGTH_M / n_segments
    mass = DENSITY_KG_M3 * np.pi * RADIUS_M**2 * LENGTH_M
    model = mj.MjModel.from_xml_string(f"""
      <mujoco><option timestep="0.001" integrator="discrete" solver="Newton" gravity="0 0 -9.81"/><worldbody>
        <flexcomp name="rod" type="grid" dim="1" count="{n_segments + 1} 1 1" spacing="{spacing} {spacing} {spacing}"
                  pos="{LENGTH_M / 2} 0 0" radius="{RADIUS_M}" mass="{mass}">
          <edge equality="true" solref="0.002 1"/>
          <elasticity young="{YOUNGS_MODULUS_PA}" poisson="{POISSON_RATIO}" damping="0.005"/>
          <contact selfcollide="none" contype="0" conaffinity="0"/>
          <pin id="0 1"/>
        </flexcomp></worldbody></mujoco>""")
    data = mj.MjData(model)
    mj.mj_forward(model, data)  # before, no vertex has a place
    name = f"MuJoCo {mj.__version__}, 1D flex, Newton"
    return Peer(name, lambda: mj.mj_step(model, data), 1e-3, lambda: data.flexvert_xpos[-1])


PEERS = (pyelastica, mujoco)
