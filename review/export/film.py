"""A recording as a film: the picture of each recorded state, drawn off the screen."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from trocar.protocol import Frame
from trocar.review.export.fluoroscopy import open_renderer
from trocar.services.cli.rerun import load
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import RecordedInputs
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.runtime.bus import Bus
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.visualization.composer import Composer

Image = npt.NDArray[np.uint8]
_CODEC, _PIXELS = "libx264", "yuv420p"
#: Every so many pictures one is whole, so that a learner finds any of them quickly.
_KEY_PICTURES = 2


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
    use_no_display()
    metadata, attachments = read_extras(path)
    if "scene.yaml" not in attachments:
        raise RecordingError(f"{path}: its scene is not in it")
    scene, duct = load(RecordedInputs(path, metadata.get("trocar", {}), attachments))
    try:
        import av

        renderer = open_renderer(view, size)
    except ModuleNotFoundError as error:
        raise MissingPackageError("mp4", error.name) from None
    newest = _Newest()
    composer = Composer(cast(Bus, newest), scene, metadata.get("trocar", {}).get("scene", ""), duct)
    drawn = 0
    with av.open(str(out), "w") as film:
        stream = film.add_stream(_CODEC, rate=rate_hz)
        stream.width, stream.height, stream.pix_fmt = *size, _PIXELS
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


def use_no_display() -> None:
    """Let VTK draw off the screen, or it complains that there is no display."""
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def write_pictures(path: Path, pictures: Iterable[Image], rate_hz: int) -> None:
    """Write pictures (height, width, 3) of one size as a film; each can be found by its time."""
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as film:
        stream = film.add_stream(_CODEC, rate=rate_hz, options={"g": str(_KEY_PICTURES)})
        for number, picture in enumerate(pictures):
            if number == 0:
                stream.height, stream.width, _ = picture.shape
                stream.pix_fmt = _PIXELS
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))
        film.mux(stream.encode(None))


def film_info(size: tuple[int, int], rate_hz: int) -> dict[str, object]:
    """Return what LeRobot tells of a film of `write_pictures`, by height and width."""
    return {
        "video.height": size[0], "video.width": size[1], "video.codec": "h264", "video.pix_fmt": _PIXELS,
        "video.is_depth_map": False, "video.fps": rate_hz, "video.channels": 3, "has_audio": False,
    }  # fmt: skip
