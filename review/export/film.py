"""A recording as a film: the picture of each recorded state, drawn off the screen."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import numpy as np

from trocar.protocol import Frame
from trocar.review.export.fluoroscopy import open_renderer
from trocar.review.export.pictures import CODEC, PIXELS
from trocar.services.cli.rerun import load
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import RecordedInputs
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.start.off_screen import draw_off_screen
from trocar.services.visualization.composer import Composer


class _Newest:
    """The newest frames of a recording up to some time, as the picture asks the bus for them."""

    def __init__(self) -> None:
        self.frames: dict[str, Frame] = {}

    def sample(self, topics: Iterable[str], _until_ns: int) -> dict[str, Frame]:
        return {topic: self.frames[topic] for topic in topics if topic in self.frames}


def write_film(
    path: Path, out: Path, view: str = "scope", rate_hz: int = 25, size: tuple[int, int] = (800, 600)
) -> None:
    """Draw a recording in its own time, as the endoscope sees it or as by X-rays.

    Raises RecordingError if it cannot be drawn, MissingPackageError if a package is not installed.
    """
    draw_off_screen(os.environ)
    scene, name, duct = recorded_scene(path)
    try:
        import av

        renderer = open_renderer(view, size)
    except ModuleNotFoundError as error:
        raise MissingPackageError("mp4", error.name) from None
    newest = _Newest()
    composer = Composer(cast(Bus, newest), scene, name, duct)
    drawn = 0
    with av.open(str(out), "w") as film:
        stream = film.add_stream(CODEC, rate=rate_hz)
        stream.width, stream.height, stream.pix_fmt = *size, PIXELS
        due_ns = 0
        for each in read_frames(path, ("gateway.state", "physics.state")):
            newest.frames[each.frame.topic] = each.frame
            due_ns = due_ns or each.time_ns
            if each.time_ns < due_ns or "physics.state" not in newest.frames:
                continue
            due_ns += 1_000_000_000 // rate_hz
            picture = composer.compose()
            renderer.update(composer.layout, picture)
            image = np.ascontiguousarray(renderer.image())
            film.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            drawn += 1
        film.mux(stream.encode(None))
    renderer.close()
    if not drawn:
        raise RecordingError(f"{path}: holds no state of physics to draw")


def recorded_scene(path: Path) -> tuple[SceneModel, str, ReducedDuct]:
    """Return the scene of a recording, its name and its duct. Raises RecordingError if its scene is not in it."""
    metadata, attachments = read_extras(path)
    about = metadata.get("trocar", {})
    if "scene.yaml" not in attachments:
        raise RecordingError(f"{path}: its scene is not in it")
    scene, duct = load(RecordedInputs(path, about, attachments))
    return scene, about.get("scene", ""), duct
