"""Cost of a picture: composing it, packing it, and drawing it on the processor where a browser cannot.

OMP_NUM_THREADS=1 python benchmarks/bench_visualization.py
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from typing import cast

import numpy as np
from report import Row, measure, parse, write_report

from trocar.protocol import Frame, bodies, topic
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.runtime.bus import bus
from trocar.services.visualization import codec
from trocar.services.visualization.composer import TOPICS, Composer

_PARTICLES = 51
_LOADED_NODES = 24
_FRAMES = 100

_RENDER = """
import sys, time
from trocar.services.runtime.bus import bus
from trocar.services.visualization import codec
from trocar.services.visualization.render import Renderer
size = (int(sys.argv[1]), int(sys.argv[2]))
hello = sys.stdin.buffer.readline().decode()
layout = codec.decode_hello(hello)
picture, _ = codec.decode(sys.stdin.buffer.read(), layout)
renderer = Renderer(off_screen=True, size=size)
renderer.update(layout, picture)
renderer.image()
start = time.process_time()
for _ in range(FRAMES):
    renderer.update(layout, picture)
    renderer.image()
print((time.process_time() - start) / FRAMES)
""".replace("FRAMES", str(_FRAMES))


class Bench:
    """A composer, and the bus that it samples: one frame of everything, decoded as it would be."""

    def __init__(self, n_modes: int) -> None:
        scene = SceneModel(duct=DuctScene(n_modes=n_modes))
        self.duct = build_scene_duct(scene)
        self._outboxes = {name: bus.Outbox(topic(name), 1) for name in TOPICS}
        self._inboxes = {name: bus.Inbox(topic(name)) for name in TOPICS}
        self._frames: dict[str, Frame] = {}
        self.composer = Composer(cast(bus.Bus, self), scene, "benchmark", self.duct)
        random = np.random.default_rng(0)
        q = pack(1e-6 * random.normal(size=n_modes))
        nodes = pack(np.arange(_LOADED_NODES), "<i4")
        loads = pack(1e-3 * random.normal(size=(_LOADED_NODES, 3)))
        line = pack(np.linspace([0.14, 0, 0], [0.04, 0, 0], _PARTICLES))
        none = pack(np.zeros((0, 3)))
        tools = tuple(
            bodies.InstrumentState(name=name, position_m=(0.03, y, 0.02), port_m=(0.03, 2 * y, 0.15))
            for name, y in (("left", 0.01), ("right", -0.01))
        )
        self.frames = {
            "gateway.state": bodies.GatewayState(tick=1, instruments=tools),
            "physics.state": bodies.PhysicsState(
                tick=1,
                tools=reaction_table((bodies.ToolReaction(),) * 2),
                duct=bodies.Duct(
                    basis_hash=self.duct.basis.content_hash, q=q, q_rate=q, load_node=nodes, load_force_n=loads
                ),
                catheter=bodies.Catheter(position_m=line, velocity_m_s=line, radius_m=8e-4),
                contacts=bodies.ContactForces(kind=pack([], "|i1"), point_m=none, force_n=none),
            ),
        }
        self.compose()

    def sample(self, _names: Iterable[str], _until_ns: int) -> dict[str, Frame]:
        """Return the newest frames: the one thing that a composer asks of its bus."""
        return self._frames

    def compose(self) -> None:
        """Compose one picture from a new frame of every topic, decoding included."""
        for name, body in self.frames.items():
            frame = self._inboxes[name].accept(self._outboxes[name].seal(body, time.monotonic_ns(), True))
            if frame is not None:
                self._frames[name] = frame
        self.picture = self.composer.compose()

    def pack(self) -> bytes:
        """Pack the picture as every client gets it."""
        return codec.encode(self.picture, time.monotonic_ns())


def render_cpu_s(bench: Bench, width: int, height: int) -> float:
    """Return the processor time of one off-screen picture, read back."""
    environment = {**os.environ, "LP_NUM_THREADS": "1", "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    hello = codec.encode_hello(bench.composer.layout).encode() + b"\n"
    done = subprocess.run(
        [sys.executable, "-c", _RENDER, str(width), str(height)],
        input=hello + bench.pack(), capture_output=True, env=environment, check=True,
    )  # fmt: skip
    return float(done.stdout)


def main() -> None:
    arguments = parse(__doc__, samples=(500, "pictures"))
    benches = {n_modes: Bench(n_modes) for n_modes in (60, 100)}
    jobs = {f"compose, {n} modes, {len(b.picture.points_m)} nodes": b.compose for n, b in benches.items()}
    jobs["pack a frame"] = benches[100].pack
    timings = measure(jobs, samples=arguments.samples)
    rows = [Row.from_timing(name, timing) for name, timing in timings.items()]
    rows.append(Row("frame on the wire", len(benches[100].pack()) / 1e3, "kB"))
    for width, height in ((800, 600), (1280, 720)):
        cpu_s = render_cpu_s(benches[100], width, height)
        rows.append(Row(f"off-screen {width} x {height}, processor time", cpu_s * 1e3, "ms"))
    write_report("visualization", "The picture", rows)


if __name__ == "__main__":
    main()
