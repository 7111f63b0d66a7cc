"""Cost of a catheter step, of what contacts ask of it, and of the same rod in other engines.

    OPENBLAS_NUM_THREADS=1 python benchmarks/bench_catheter.py

Peers are timed where they are installed (`pip install pyelastica mujoco`); the notes say which were not.
"""

from __future__ import annotations

import os

# Before numpy is loaded: a second BLAS thread only disturbs what is timed here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable

import numpy as np
from catheter_peers import PEERS
from report import Row, Timing, measure, parse, write_report

from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    Introducer,
    RodProperties,
    SemiImplicitIntegrator,
    Supports,
    clamped,
    straight_rod,
)
from trocar.studies.published.rods import GJ, X, elastica_tip, example_rod

DT_S = 1e-3
STEP_BUDGET_S = 30e-6
# P L^2/EI = 10: the deflection of the elastica over the length
ELASTICA_DEFLECTION = 0.81061


def swinging(properties: RodProperties, supports: Supports, **settings) -> Callable[[], None]:
    """A step of a rod that swings under its weight and starts again every two seconds."""
    integrator = ImplicitIntegrator(properties, supports, **settings)
    start = straight_rod(properties, (0, 0, 0), X)
    state = start.copy()
    weight = properties.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])
    count = 0

    def step() -> None:
        nonlocal count
        integrator.predict(state, weight, DT_S)
        count += 1
        if count % 2000 == 0:
            state.position_m[:] = start.position_m
            state.velocity_m_s[:] = 0.0

    return step


def step_calls() -> dict[str, Callable[[], None]]:
    damping = {"internal_damping_s": 1e-3, "viscous_drag_n_s_m2": 0.02}
    plain = example_rod(50, **damping)
    curvature = np.zeros((49, 3))
    curvature[-8:, 0] = 60.0
    twisted = example_rod(50, **damping, torsional_stiffness_n_m2=GJ, rest_curvature_1_m=curvature)
    introducer = Supports(held=(0,), introducer=Introducer((0.01, 0, 0), (0.04, 0, 0), friction=0.1))
    return {
        "step, 50 segments, clamped, damped": swinging(plain, clamped(X)),
        "step, 50 segments, with twist and a bent tip": swinging(twisted, clamped(X)),
        "step, 50 segments, through an introducer with friction": swinging(plain, introducer),
        "step, 100 segments": swinging(example_rod(100, **damping), clamped(X)),
    }


def worst_step() -> Callable[[], None]:
    """A step from random velocities of 10 m/s: as many Newton iterations as it may take."""
    properties = example_rod(50, axial_stiffness_n=1e5)
    integrator = ImplicitIntegrator(properties, clamped(X))
    start = straight_rod(properties, (0, 0, 0), X)
    start.velocity_m_s[:] = 10.0 * np.random.default_rng(0).normal(size=(51, 3))
    state, nothing = start.copy(), np.zeros((51, 3))

    def step() -> None:
        state.position_m[:] = start.position_m
        state.velocity_m_s[:] = start.velocity_m_s
        integrator.predict(state, nothing, DT_S)

    step()
    print(f"worst step: {integrator.iterations} iterations")
    return step


def contact_calls() -> dict[str, Callable[[], None]]:
    properties = example_rod(50)
    integrator = ImplicitIntegrator(properties, clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    integrator.predict(state, np.zeros((51, 3)), DT_S)
    calls: dict[str, Callable[[], None]] = {}
    for touched in (6, 30):
        particles = np.arange(50 - touched, 50, dtype=np.int32)
        out = np.empty((3 * touched, 3 * touched))
        calls[f"compliance between {touched} particles"] = lambda particles=particles, out=out: integrator.compliance(
            particles, out
        )
    force, changes = np.random.default_rng(0).normal(size=(51, 3, 90)), np.empty((51, 3, 90))
    calls["solve, 90 right-hand sides of 153 unknowns"] = lambda: integrator.solve(force, changes)
    contact = np.zeros((51, 3))
    calls["correct"] = lambda: integrator.correct(state, contact)
    return calls


def semi_implicit() -> tuple[Callable[[], None], int]:
    properties = example_rod(50, viscous_drag_n_s_m2=0.02)
    integrator = SemiImplicitIntegrator(properties, clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    weight = properties.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])
    return lambda: integrator.predict(state, weight, DT_S), integrator.substeps(DT_S)


def peer_rows() -> tuple[list[Row], list[str]]:
    rows, absent = [], []
    for build in PEERS:
        try:
            peer = build(50)
        except ImportError as error:
            absent.append(f"{build.__name__} was not timed: {error}.")
            continue
        timing = measure({peer.name: peer.step}, samples=2000)[peer.name]
        finite = np.isfinite(peer.tip_m()).all()
        note = f"step of {1e6 * peer.dt_s:.3g} us{'' if finite else ', diverged'}"
        rows.append(Row.from_timing(f"{peer.name}, 50 segments, per step", timing, note=note))
        per_millisecond = timing.median_s * DT_S / peer.dt_s
        rows.append(Row(f"{peer.name}, per simulated ms", 1e6 * per_millisecond, "us"))
    return rows, absent


def limited(timings: dict[str, Timing]) -> list[Row]:
    return [
        Row.from_timing(name, timing, STEP_BUDGET_S if "50 segments" in name else None)
        for name, timing in timings.items()
    ]


def main() -> None:
    arguments = parse(__doc__, samples=(4000, "steps of each kind"))
    rows = limited(measure(step_calls(), samples=arguments.samples))
    worst = measure({"worst step": worst_step()}, samples=max(arguments.samples // 4, 1))["worst step"]
    rows.append(Row.from_timing("worst step: random 10 m/s, EA 1e5 N, most iterations", worst))
    rows += [
        Row.from_timing(name, timing)
        for name, timing in measure(contact_calls(), samples=max(arguments.samples // 2, 1)).items()
    ]
    call, substeps = semi_implicit()
    timing = measure({"semi-implicit": call}, samples=500)["semi-implicit"]
    rows.append(Row.from_timing("semi-implicit (eq. 27-28), a step of 1 ms", timing, note=f"{substeps} substeps"))
    error = abs(elastica_tip(10.0)[1] / ELASTICA_DEFLECTION - 1.0)
    rows.append(Row("elastica, tip error at PL²/EI = 10", 100.0 * error, "%", 0.5))
    peers, absent = peer_rows()
    notes = "Rod of 100 mm, radius 0.75 mm, E 100 MPa, 1100 kg/m3 (EI 25 N mm², EA 177 N); implicit steps of 1 ms. "
    write_report("catheter", "Catheter", [*rows, *peers], notes + " ".join(absent))


if __name__ == "__main__":
    main()
