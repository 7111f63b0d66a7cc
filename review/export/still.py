"""The cholangiogram of an attempt's end, with what it shows: ``python -m trocar.review.export.still`` writes both.

It is a process of its own, which a school starts when a report asks for it, after everything else on the machine.
Agent is injected while all lies as it did at the end of the attempt, for as long as fills the duct.
"""

from __future__ import annotations

import base64
import os
import sys
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import cast

import msgspec
import numpy as np

from trocar.protocol import Frame
from trocar.protocol.topics import TICK_S
from trocar.review.export.cholangiogram import RATE_M3_S, Cholangioscope
from trocar.review.export.contrast_flow import steady_flow
from trocar.review.export.film import recorded_scene
from trocar.review.export.pictures import Camera
from trocar.review.export.png import grey_png
from trocar.services.files.atomic_file import atomic_file
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import RecordedFrame, read_frames
from trocar.services.runtime.errors import UserError
from trocar.services.visualization.picture import PictureLayout

SIZE = 640, 480  # so that a picture fills the column of a report on a desk, whose file grows by some 30 kB
INJECTED_S = 40.0
"""Of injection, so that 10 ml come, of 5 to 20 that one gives in an operation: an assumption."""
_SEEN = 0.5
"""Share of agent from which on it counts as seen, as an observer sees half of the contrast that is full."""
_NICE = 19  # after everything else on the machine, as a rig may run on it
_BEFORE_S = 2.0
"""From how long before the end on a recording is read, so that both topics of a picture have come."""


class Moment(msgspec.Struct, frozen=True, kw_only=True):
    """The end of an attempt: its tick, -1 if unknown, and its wall-clock time, which is early where time was slowed."""

    tick: int
    time_ns: int


class Still(msgspec.Struct, frozen=True, kw_only=True):
    """The picture, a PNG file in base 64, and what it shows, a sentence each."""

    image: str
    words: list[str]


def still_of(path: Path, end: Moment) -> Still:
    """Return the cholangiogram of a recording at the end of an attempt.

    Raises RecordingError if the recording does not reach it, or its scene is not in it.
    """
    scene, name, duct = recorded_scene(path)
    with closing(Camera(scene, name, duct, SIZE, "cholangiogram")) as camera:
        layout, picture = camera.compose(last_frames(path, end))
        view = cast(Cholangioscope, camera.renderer)
        view.update(layout, picture)
        picture.tick += round(INJECTED_S / TICK_S)
        view.update(layout, picture)
        grey = np.ascontiguousarray(view.image()[:, :, 0])
    through = "the mouth" if scene.duct.incision is None else "the cut"
    return Still(image=base64.b64encode(grey_png(grey)).decode(), words=findings(view, layout, through))


def last_frames(path: Path, end: Moment) -> dict[str, Frame]:
    """Return the newest frames at the end of an attempt. Raises RecordingError if the recording ends before."""
    newest: dict[str, Frame] = {}
    for each in read_frames(path, ("gateway.state", "physics.state"), end.time_ns - round(1e9 * _BEFORE_S)):
        if "gateway.state" in newest and "physics.state" in newest and _is_at_end(each, newest, end):
            return newest
        newest[each.frame.topic] = each.frame
    raise RecordingError(f"{path.name}: does not hold the end of the attempt, or not yet")


def _is_at_end(each: RecordedFrame, newest: Mapping[str, Frame], end: Moment) -> bool:
    if end.tick < 0:
        return each.time_ns >= end.time_ns
    return bool(newest["gateway.state"].body.tick >= end.tick)


def findings(view: Cholangioscope, layout: PictureLayout, through: str) -> list[str]:
    """Return what a cholangiogram shows, a sentence each; ``through`` is what agent may come back out of."""
    lumen = view.lumen
    if lumen.tip is None:
        return ["No agent comes into the duct: the tip is outside."]
    clamped = set(layout.clamped)
    far = [k for k, rim in enumerate(lumen.cells.openings) if clamped & set(rim.tolist())]
    reaches = any(view.flow.share[lumen.cells.opening_cells[k]].max() >= _SEEN for k in far)
    words = [f"Agent {'reaches' if reaches else 'does not reach'} the common duct."]
    flow = steady_flow(lumen.channel, lumen.tip, RATE_M3_S)
    back = round(100.0 * flow.out_m3_s[~np.isin(lumen.outlets[:, 0], far)].sum() / RATE_M3_S)
    if back:
        words.append(f"{back} % of the agent comes back through {through}.")
    return words + _gaps(view)


def _gaps(view: Cholangioscope) -> list[str]:
    """Return a sentence for each stone and bubble in agent, from the mouth on, and one of bubbles that have left."""
    lumen, found = view.lumen, []
    stones = [body for body in lumen.bodies if body.ball_radius_m > 0.0]
    for kind, bodies in (("a stone", stones), ("a bubble of air", view.bubbles.displacers())):
        for body in bodies:
            cells = lumen.cells_at(body.places_m)
            if float(np.mean(view.flow.share[cells])) >= _SEEN:
                away_mm = 1e3 * float(np.mean(lumen.cells.away_m[cells]))
                found.append((away_mm, 2e3 * body.ball_radius_m, kind))
    words = [f"A gap of {wide:.1f} mm, {away:.0f} mm from the mouth: {kind}." for away, wide, kind in sorted(found)]
    if flushed := len(view.bubbles.left):
        words.append("1 bubble of air was flushed out." if flushed == 1 else f"{flushed} bubbles were flushed out.")
    return words


def main(path: Path, out: Path, end: Moment) -> None:
    """Write the still of a recording into a file."""
    with suppress(OSError):
        os.nice(_NICE)
    still = still_of(path, end)
    with atomic_file(out) as half:
        half.write_bytes(msgspec.json.encode(still))


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]), Moment(tick=int(sys.argv[3]), time_ns=int(sys.argv[4])))
    except UserError as error:
        sys.exit(str(error))
