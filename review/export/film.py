"""A recording as a film: the picture of each recorded state, drawn off the screen."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from itertools import chain
from pathlib import Path

from trocar.protocol import Frame
from trocar.review.export.pictures import Camera, Image, write_pictures
from trocar.services.cli.rerun import load
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import RecordedInputs
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.start.off_screen import draw_off_screen


def write_film(
    path: Path, out: Path, view: str = "scope", rate_hz: int = 25, size: tuple[int, int] = (800, 600)
) -> None:
    """Draw a recording in its own time, as the endoscope sees it or as by X-rays.

    Raises RecordingError if it cannot be drawn, MissingPackageError if a package is not installed.
    """
    try:
        import av  # noqa: F401
    except ModuleNotFoundError as error:
        raise MissingPackageError("mp4", error.name) from None
    with closing(recorded_camera(path, view, size, "mp4")) as camera:
        pictures = _pictures(path, camera, 1_000_000_000 // rate_hz)
        first = next(pictures, None)
        if first is None:
            raise RecordingError(f"{path}: holds no state of physics to draw")
        write_pictures(out, chain([first], pictures), rate_hz, key_pictures=None)


def _pictures(path: Path, camera: Camera, period_ns: int) -> Iterator[Image]:
    newest: dict[str, Frame] = {}
    due_ns = 0
    for each in read_frames(path, ("gateway.state", "physics.state")):
        newest[each.frame.topic] = each.frame
        due_ns = due_ns or each.time_ns
        if each.time_ns >= due_ns and "physics.state" in newest:
            due_ns += period_ns
            yield camera.image(newest)


def recorded_camera(path: Path, view: str, size: tuple[int, int], needed_for: str = "an image") -> Camera:
    """Return a view of the scene of a recording.

    Raises RecordingError if its scene is not in it, MissingPackageError if a package is not installed.
    """
    draw_off_screen(os.environ)
    return Camera(*recorded_scene(path), size, view, needed_for)


def recorded_scene(path: Path) -> tuple[SceneModel, str, ReducedDuct]:
    """Return the scene of a recording, its name and its duct. Raises RecordingError if its scene is not in it."""
    metadata, attachments = read_extras(path)
    about = metadata.get("trocar", {})
    if "scene.yaml" not in attachments:
        raise RecordingError(f"{path}: its scene is not in it")
    scene, duct = load(RecordedInputs(path, about, attachments))
    return scene, about.get("scene", ""), duct
