"""What it costs to record every frame of every fast topic, and how much is lost.

    python benchmarks/bench_recorder.py
    python benchmarks/bench_recorder.py --rig [--minutes 10]

A process of the ordinary class publishes all four 1 kHz topics, each frame with other numbers, as large as those of the
default scene with both tools in contact; the recorder records every frame of all, or of the devices as it does by
default. In one run it is stopped for two seconds, as by a machine that has no time for it. With ``--rig`` it is the
stub rig itself that is recorded whole, beside stress-ng (a Debian package) on both cores: what the recorder loses and
takes, what the loops miss, and how many alarms were false.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from report import Row, write_report

from trocar.protocol import bodies
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, TOOL_COLUMNS
from trocar.protocol.bodies.physics import REACTION_COLUMNS, Catheter, ContactForces, Duct
from trocar.services.recordings.reader import read_frames
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

TOPICS = ("gateway.state", "haptics.contact_model", "haptics.contacts", "physics.state")
MODES, PARTICLES, PAIRS = 100, 51, 12
SECONDS = 10.0
_TICK_S = 1e-3
_SETTLE_S = 5.0


class Numbers:
    """Sources of numbers that differ from frame to frame in their low bits, as a simulation's do."""

    def __init__(self) -> None:
        self._values = np.random.default_rng(0).standard_normal(4096)

    def array(self, *shape: int) -> np.ndarray:
        """Return the next numbers of a slow walk."""
        self._values += 1e-6
        return self._values[: int(np.prod(shape))].reshape(shape)

    def vector(self, n: int) -> tuple[float, ...]:
        """Return them as a vector."""
        return tuple(self.array(n).tolist())


def frames(numbers: Numbers, tick: int) -> dict[str, object]:
    """Return the bodies of a tick."""
    a, v = numbers.array, numbers.vector
    return {
        "gateway.state": bodies.GatewayState(
            tick=tick,
            instruments=tuple(
                bodies.InstrumentState(
                    name=name, position_m=v(3), velocity_m_s=v(3), applied_force_n=v(3), port_m=v(3), state="active"
                )
                for name in ("left", "right")
            ),
        ),
        "haptics.contact_model": bodies.ContactModel(tick=tick, ttl_s=0.02, models=pack(a(2, MODEL_COLUMNS))),
        "haptics.contacts": bodies.ToolContacts(
            tick=tick,
            tools=pack(a(2, TOOL_COLUMNS)),
        ),
        "physics.state": bodies.PhysicsState(
            tick=tick,
            tools=pack(a(2, REACTION_COLUMNS)),
            duct=Duct(
                basis_hash="0" * 64, q=pack(a(MODES)), q_rate=pack(a(MODES)),
                load_node=pack(np.arange(PAIRS), "<i4"), load_force_n=pack(a(PAIRS, 3)),
            ),
            catheter=Catheter(position_m=pack(a(PARTICLES, 3)), velocity_m_s=pack(a(PARTICLES, 3)), radius_m=8e-4),
            contacts=ContactForces(
                kind=pack(np.zeros(2 * PAIRS), "|i1"), point_m=pack(a(2 * PAIRS, 3)), force_n=pack(a(2 * PAIRS, 3))
            ),
        ),
    }  # fmt: skip


def publish(directory: str, seconds: float) -> None:
    """Publish every topic a thousand times a second, once somebody reads them all."""
    bus, numbers = ZmqBus(Transport(directory=Path(directory)), publishes=TOPICS), Numbers()
    while not bus.has_reader(TOPICS[0]):
        time.sleep(0.01)
    time.sleep(0.2)  # for the others, which it has asked for together with this one
    for name in TOPICS:
        bus.has_reader(name)
    begun_s = time.monotonic()
    for tick in range(round(seconds / _TICK_S)):
        for name, body in frames(numbers, tick).items():
            bus.publish(name, body)  # type: ignore[arg-type]
        time.sleep(max(0.0, begun_s + (tick + 1) * _TICK_S - time.monotonic()))
    time.sleep(0.5)
    bus.close()


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has taken."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def record(whole: tuple[str, ...], stopped_s: float = 0.0) -> tuple[float, int, int, float]:
    """Return the recorder's share of a core, frames of `whole` topics published and lost, and megabytes a minute."""
    with tempfile.TemporaryDirectory() as folder:
        names = ",".join((*whole, "supervisor.state"))
        settings = (f"transport.directory={folder}/bus", f"recorder.directory={folder}", f"recorder.whole=[{names}]")
        options = [word for setting in settings for word in ("--set", setting)]
        recorder = subprocess.Popen([sys.executable, "-m", "trocar.services.recorder", *options])
        publisher = subprocess.Popen([sys.executable, __file__, "publish", f"{folder}/bus", str(SECONDS)])
        time.sleep(4.0)
        before_s, began_s = cpu_s(recorder.pid), time.monotonic()
        if stopped_s:
            recorder.send_signal(signal.SIGSTOP)
            time.sleep(stopped_s)
            recorder.send_signal(signal.SIGCONT)
        time.sleep(4.0)
        share = (cpu_s(recorder.pid) - before_s) / (time.monotonic() - began_s)
        publisher.wait()
        recorder.terminate()
        recorder.wait()
        (path,) = Path(folder).glob("*.mcap")
        sequences: dict[str, Counter[int]] = {name: Counter() for name in TOPICS}
        for each in read_frames(path):
            sequences.setdefault(each.frame.topic, Counter())[each.frame.sequence] += 1
        published = len(whole) * round(SECONDS / _TICK_S)
        kept = sum(len(sequences[name]) for name in whole)
        return share, published, published - kept, path.stat().st_size / 1e6 * 60.0 / SECONDS


def record_rig(minutes: float) -> None:
    """Record a rig whole beside stress-ng, and write the table."""
    from watched_rig import STRESS, WatchedRig, print_alarms

    names = ",".join((*TOPICS, "supervisor.state"))
    with WatchedRig(["--set", f"recorder.whole=[{names}]"]) as rig:
        rig.settle(_SETTLE_S)
        stress = subprocess.Popen(STRESS, stderr=subprocess.DEVNULL)
        try:
            rig.watch(60.0 * minutes)
        finally:
            stress.terminate()
            stress.wait()
        print_alarms(rig, "stress-ng")
        ran_s = rig.history.change('trocar_processor_seconds_total{service="recorder"}')
        published = sum(rig.history.change(f'trocar_topic_messages_total{{topic="{name}"}}') for name in TOPICS)
        rows = [
            Row("recorder: processor time", 100.0 * ran_s / rig.seconds, "% of a core", limit=10.0),
            Row("recorder: frames of the four topics published", published, "frames"),
            Row("recorder: frames recorded since its start", rig.gauge("recorder", "recorded_frames"), "frames"),
            Row("recorder: frames lost", rig.gauge("recorder", "lost_frames"), "frames", limit=0.0),
            *rig.rows("stress-ng"),
        ]
    notes = f"{minutes:g} minutes beside `{' '.join(STRESS)}`. An alarm is false where no histogram shows what it says."
    write_report("recorder-stress", "The rig recorded whole, beside stress-ng on both cores", rows, notes)


def main() -> None:
    """Measure undisturbed, then with the recorder held up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", action="store_true", help="record the stub rig beside stress-ng")
    parser.add_argument("--minutes", type=float, default=10.0, help="of --rig")
    arguments = parser.parse_args()
    if arguments.rig:
        record_rig(arguments.minutes)
        return
    rows = []
    for name, whole, stopped_s in (
        ("all four", TOPICS, 0.0),
        ("all four, stopped for 2 s", TOPICS, 2.0),
        ("gateway.state, the others 25 times a second", TOPICS[:1], 0.0),
    ):
        share, published, lost, mb_min = record(whole, stopped_s)
        rows.append(Row(f"{name}: processor time", 100.0 * share, "% of a core", limit=None if stopped_s else 10.0))
        rows.append(Row(f"{name}: frames lost of {published}", lost, "frames", limit=0))
        rows.append(Row(f"{name}: file", mb_min, "MB a minute"))
    write_report("recorder", "The recorder: every frame of four 1 kHz topics", rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["publish"]:
        publish(sys.argv[2], float(sys.argv[3]))
    else:
        main()
