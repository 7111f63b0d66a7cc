"""Error against time beside peers: a clamped rod that falls under its weight, in MuJoCo, PyElastica and here.

    pip install pyelastica mujoco     in an environment of their own: the project does not depend on them
    python benchmarks/bench_peers.py

Each engine computes the first 30 ms of the same fall with several numbers of segments; its error is that of the tip's
way, root mean square over the fall, against this project's rod with many segments and a twentieth of the step, to
which PyElastica converges as well. Its cost is that of a simulated millisecond, with as many steps as the engine needs.

It is not the same work: PyElastica's rod also shears and twists and is explicit; MuJoCo's is a general solver's, with
stretch as a soft constraint and damping of its own; ours has stretch and bending alone and prepares the matrix that
contacts need. None has contacts here.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from catheter_peers import PEERS, Peer
from report import Row, parse, write_report

from trocar.services.mechanics.rod import ImplicitIntegrator, clamped, straight_rod
from trocar.studies.published.rods import X, example_rod

FALL_S = 30e-3
SEGMENTS = (10, 20, 40, 80)
_REFERENCE = (160, 5e-5)
_REPEATS = 3


def ours(n_segments: int, dt_s: float = 1e-3) -> Peer:
    """Return this project's rod, undamped but for what the integrator takes of what no step resolves."""
    properties = example_rod(n_segments)
    integrator = ImplicitIntegrator(properties, clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    weight = properties.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])
    name = f"Trocar, implicit at {1e3 * dt_s:g} ms"
    return Peer(name, lambda: integrator.predict(state, weight, dt_s), dt_s, lambda: state.position_m[-1])


def fall(peer: Peer) -> tuple[np.ndarray, float]:
    """Return the tip's way (k, 3) in m from where it began, once a millisecond, and us of a simulated millisecond."""
    began, way, took_s, time_s = np.array(peer.tip_m()), [], [], 0.0
    for tick in range(1, round(FALL_S / 1e-3) + 1):
        steps, spent_s = round((tick * 1e-3 - time_s) / peer.dt_s), 0.0
        for _ in range(steps):
            start = time.perf_counter()
            peer.step()
            spent_s += time.perf_counter() - start
        time_s += steps * peer.dt_s
        took_s.append(spent_s)
        way.append(np.array(peer.tip_m()) - began)
    return np.array(way), 1e6 * float(np.median(took_s))


def measured(build: Callable[[], Peer], wanted_m: np.ndarray) -> tuple[str, float, float]:
    """Return name, error in per cent and cost in us: the median of a few falls."""
    falls = [(peer.name, *fall(peer)) for peer in (build() for _ in range(_REPEATS))]
    name, way, _ = falls[0]
    error = 100.0 * float(np.sqrt(np.mean((way - wanted_m) ** 2) / np.mean(wanted_m**2)))
    return name, error, float(np.median([cost_us for *_, cost_us in falls]))


def main() -> None:
    """Measure and write the table."""
    parse(__doc__)
    fall(ours(10))  # compile
    wanted_m, _ = fall(ours(*_REFERENCE))
    builds: list[Callable[..., Peer]] = [ours, lambda n: ours(n, 5e-4), *PEERS]
    rows, absent = [], set()
    for build in builds:
        for n_segments in SEGMENTS:
            try:
                name, error, cost_us = measured(lambda build=build, n=n_segments: build(n), wanted_m)
            except ImportError as missing:
                absent.add(str(missing))
                continue
            except ValueError as refused:
                absent.add(f"{build.__name__} refuses {n_segments} segments: {' '.join(str(refused).split())}.")
                continue
            told = f"{error:.3g} %" if np.isfinite(error) else "diverged"
            rows.append(Row(f"{name}, {n_segments} segments: error {told}", cost_us, "us"))
    notes = (
        f"First {1e3 * FALL_S:g} ms of the fall of a clamped rod (100 mm, radius 0.75 mm, 100 MPa, 1100 kg/m3): error "
        f"of the tip's way against {_REFERENCE[0]} segments at {1e3 * _REFERENCE[1]:g} ms, and what a simulated "
        "millisecond costs. Not the same work: PyElastica's rod also shears and twists and is explicit; MuJoCo's "
        "stretches by a soft constraint, with damping of its own; ours stretches and bends. "
    )
    write_report("peers", "A falling rod beside peers", rows, notes + " ".join(sorted(absent)))


if __name__ == "__main__":
    main()
