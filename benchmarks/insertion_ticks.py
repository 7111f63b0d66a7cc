"""One insertion in this process, as fast as it goes: median and 99th percentile of a tick, and the bits of its end.

    python benchmarks/insertion_ticks.py [SCENE]

It prints one line of JSON. `benchmarks/bench_pythons.py` calls it with several Pythons in turns, and with kernels that
were compiled for this processor or for the fixed target. It imports nothing of its neighbours, so that it can be run
beside a package that is installed elsewhere.
"""

from __future__ import annotations

import trocar.services.start.entry  # first: the environment of a process

# isort: split
import argparse
import gc
import hashlib
import json
import platform
import time

import numpy as np

import trocar
from trocar.services.mechanics.compiled import KERNELS
from trocar.services.runtime.realtime import realtime

#: Ticks before the measured ones: caches and branch predictors are warm.
WARM_UP_TICKS = 200


def main(scene: str) -> None:
    """Run the insertion of a scene and print what it took."""
    simulation, hands = trocar.simulate(trocar.load_scene(scene)), trocar.Hands()
    motion = trocar.expert(simulation)
    realtime.set_up(1, 60)
    gc.disable()
    times_ns = []
    for tick in range(int(motion.duration_s / 1e-3)):
        motion.write_inputs(tick * 1e-3, hands)
        began_ns = time.perf_counter_ns()
        simulation.step(hands)
        times_ns.append(time.perf_counter_ns() - began_ns)
    times_us = np.array(times_ns[WARM_UP_TICKS:]) / 1e3
    state = [simulation.duct.state.q, simulation.catheter.state.position_m]
    answer = {
        "python": platform.python_version(),
        "ticks": len(times_us),
        "median_us": round(float(np.median(times_us)), 2),
        "p99_us": round(float(np.percentile(times_us, 99)), 2),
        "compiled": sum(bool(each.stats.cache_misses) for each in KERNELS),
        "end": hashlib.sha256(b"".join(array.tobytes() for array in state)).hexdigest()[:16],
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="insertion", help="one that has hands (default insertion)")
    main(parser.parse_args().scene)
