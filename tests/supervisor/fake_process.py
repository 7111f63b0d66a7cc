"""A tiny process for the launcher's tests: beats and ticks as $FAKE_NAME, misbehaves as $FAKE_WORDS says.

Words: ``exit`` (ends with code 2 and a sentence), ``slow`` (misses half its ticks), ``mute`` (never says ready),
``crash`` (dies of a signal), ``stubborn`` (does not end when asked), ``full`` (ends a while after it was ready, as a
recorder whose disk is full), ``full_at_last`` (so, when it is asked to end), ``closed`` (ends a while after it was
ready, as a window that is closed).
"""

from __future__ import annotations

import os
import signal
import sys
import time

import msgspec

import trocar.protocol.bodies as bodies
from tests.protocol import samples
from trocar.services.recordings.errors import RecordingError
from trocar.services.runtime import log
from trocar.services.runtime.errors import ConfigError, EndOfRig
from trocar.services.runtime.loop.loop import LoopMeter, ticks
from trocar.services.runtime.process.process import Process, main

RATE_HZ = float(os.environ.get("FAKE_RATE", "200"))


def stream_body(name: str, tick: int) -> msgspec.Struct | None:
    """Return a frame of the process' 1 kHz stream, None where it has none."""
    match name:
        case "gateway":
            return bodies.GatewayState(tick=tick)
        case "haptics":
            return bodies.ContactModel.of(tick, 0.02, ())
        case "physics":
            return samples.physics_state(tick)
    return None


STREAMS = {"gateway": "gateway.state", "haptics": "haptics.contact_model", "physics": "physics.state"}


def run(process: Process) -> None:
    words = os.environ.get("FAKE_WORDS", "").split()
    if "exit" in words:
        raise ConfigError("configs/made_up.yaml: this key is missing")
    if "crash" in words:
        os.kill(os.getpid(), signal.SIGKILL)
    if "stubborn" in words:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    log.progress("building what a fake needs", 0.5)
    meter = LoopMeter(RATE_HZ)
    if "mute" not in words:
        process.ready(meter)
    for tick in ticks(meter, process.stop):
        body = stream_body(process.name, tick.index)
        if body is not None:
            process.bus.publish(STREAMS[process.name], body, origin_ns=time.monotonic_ns())
        if "slow" in words and tick.index % 4 < 2:
            time.sleep(0.006)
        if process.name == "gateway":
            for frame in process.bus.drain("supervisor.state"):
                process.health.gauges["safe_stop"] = float(frame.body.safe_stop)
        process.health.send_if_due()
        if "full" in words and tick.index > RATE_HZ:
            raise RecordingError("a.mcap: no space left on device; 200 frames were kept")
        if "closed" in words and tick.index > RATE_HZ:
            raise EndOfRig("the window was closed")
    if "full_at_last" in words:
        raise RecordingError("a.mcap: no space left on device; 100 frames were kept")


if __name__ == "__main__":
    code = main(os.environ["FAKE_NAME"], run)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # to take all modules apart that a fork has copied takes longer than all that a fake does
