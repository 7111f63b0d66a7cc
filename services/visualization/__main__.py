"""The visualization process: composes pictures at the view's rate and streams or draws them."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import sys
import time

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.errors import EndOfRig
from trocar.services.runtime.log import progress
from trocar.services.runtime.loop.loop import LoopMeter, ticks
from trocar.services.runtime.process.process import Process, ProcessConfig, main
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.drawn_surface import DrawnSurface
from trocar.services.visualization import tool_pose
from trocar.services.visualization.composer import TOPICS, Composer
from trocar.services.visualization.outputs import open_output
from trocar.services.visualization.page_hands import TOPIC as HANDS
from trocar.services.visualization.page_hands import PageHands
from trocar.services.visualization.rig_state import RigNotice

#: Deadline of a picture, of 30 Hz, as that is promised, even if the rig file sets a faster rate.
PICTURE_DEADLINE_NS = 33_333_333
#: Least rate of waking between pictures for health reports, as silence for half a second counts as a hang.
REPORTS_HZ = 10.0


def prepare(process_config: ProcessConfig) -> tuple[SceneModel, ReducedDuct]:
    """Load the scene and its duct, and compile the kernels of a picture."""
    scene = load_scene(process_config.scene_name, process_config.scene_overrides)
    duct = load_duct(scene, cache_directory(), progress)
    DrawnSurface(duct).warm_up()
    tool_pose.orientation(np.ones(3), (0.0, 0.0, 0.0), 0.0)
    return scene, duct


def composing_hz(wanted_hz: float | None, most_hz: float) -> float:
    """Return the rate of composing for clients that accept at most `wanted_hz`."""
    return min(most_hz, max(wanted_hz or most_hz, REPORTS_HZ))


def run(process: Process, prepared: tuple[SceneModel, ReducedDuct]) -> None:
    """Compose, show and report; serve clients or process window events while waiting for the next picture.

    No more pictures are composed than clients accept, so that slow browsers cost less.
    """
    settings = process.rig.visualization
    health = process.health
    painted = health.path("device_pixel", PICTURE_DEADLINE_NS)
    scene, duct = prepared
    topics = filter(process.requirements.is_published, TOPICS)
    composer = Composer(process.bus, scene, process.scene_name, duct, topics)
    rig_state = RigNotice(process.bus)
    hands = PageHands(
        followers=process.rig.page_hands(),
        publish=lambda body: process.bus.publish(HANDS, body, at_once=True),
        devices=composer.devices,
        token_sha256=rig_state.token_sha256,
    )
    output = open_output(process.rig, painted, process.log, hands)
    meter = LoopMeter(settings.rate_hz, ("compose", "show"))
    process.ready(meter)
    health.change("running")
    try:
        for _ in ticks(meter, lambda: process.stop() or output.closed, output.wait_until):
            started_ns = time.monotonic_ns()
            picture = composer.compose()
            composed_ns = time.monotonic_ns()
            output.show(composer.layout, picture, rig_state.notice())
            meter.stages_ns = (composed_ns - started_ns, time.monotonic_ns() - composed_ns)
            health.gauges.update(output.gauges())
            health.gauges["duct_frames_refused"] = float(composer.refused)
            meter.change_rate(composing_hz(output.wanted_hz(), settings.rate_hz))
            health.send_if_due()
    finally:
        output.close()
    if output.closed:
        raise EndOfRig("the window was closed")


if __name__ == "__main__":
    sys.exit(main("visualization", run, prepare=prepare))
