"""The duct and a catheter lying in it in MuJoCo, as near to our benchmark as its models come.

A missing package raises ImportError with its name; `pip install mujoco` in an environment of its own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

RADIUS_M, LENGTH_M, THICKNESS_M, YOUNGS_MODULUS_PA, DENSITY_KG_M3 = 4e-3, 40e-3, 1e-3, 3e6, 1060.0
CATHETER_M, CATHETER_RADIUS_M = 0.1, 0.835e-3


def tube(n_around: int, n_along: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3) of a tube along x."""
    angle = 2.0 * np.pi * np.arange(n_around) / n_around
    ring = RADIUS_M * np.stack([np.zeros(n_around), np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([ring + np.array([x, 0.0, 0.0]) for x in np.linspace(0.0, LENGTH_M, n_along)])
    here = np.arange(n_around * (n_along - 1))
    across = here // n_around * n_around + (here + 1) % n_around
    lower = np.stack([here, across, here + n_around], axis=1)
    upper = np.stack([across, across + n_around, here + n_around], axis=1)
    return points, np.concatenate([lower, upper])


def mujoco_duct(n_around: int, n_along: int, n_segments: int) -> tuple[str, Callable[[], None], Callable[[], int]]:
    """Return name, step of 1 ms and contact count of a pinned shell flex with a rod flex lying in it."""
    import mujoco as mj

    points, triangles = tube(n_around, n_along)
    spacing = CATHETER_M / n_segments
    wall_kg = DENSITY_KG_M3 * 2.0 * np.pi * RADIUS_M * LENGTH_M * THICKNESS_M
    rod_kg = DENSITY_KG_M3 * np.pi * CATHETER_RADIUS_M**2 * CATHETER_M
    bottom = RADIUS_M - 0.5 * THICKNESS_M - CATHETER_RADIUS_M
    model = mj.MjModel.from_xml_string(f"""
      <mujoco><option timestep="0.001" integrator="discrete" solver="Newton" gravity="0 0 -20"/>
      <size memory="500M"/>
      <worldbody>
        <flexcomp name="duct" type="direct" dim="2" radius="{0.5 * THICKNESS_M}" mass="{wall_kg}"
                  point="{_numbers(points)}" element="{_numbers(triangles)}">
          <pin id="{_numbers(np.arange(n_around))}"/><contact selfcollide="none" condim="3"/>
          <elasticity young="{YOUNGS_MODULUS_PA}" poisson="0.45" thickness="{THICKNESS_M}" damping="0.01"
                      elastic2d="both"/></flexcomp>
        <flexcomp name="rod" type="grid" dim="1" count="{n_segments + 1} 1 1" spacing="{spacing} {spacing} {spacing}"
                  pos="{2e-3 + 0.5 * CATHETER_M} 0 {-bottom}" radius="{CATHETER_RADIUS_M}" mass="{rod_kg}">
          <edge equality="true" solref="0.004 1"/><contact selfcollide="none" condim="3"/></flexcomp>
      </worldbody></mujoco>""")
    data = mj.MjData(model)
    name = f"MuJoCo {mj.__version__}, shell flex of {len(points)} vertices, rod flex"
    return name, lambda: mj.mj_step(model, data), lambda: int(data.ncon)


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.7g}" for value in values.ravel())
