"""Off-screen pictures: in a process of their own, because a wrong graphics driver ends in a segmentation fault."""

import ctypes.util
import io
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from tests.visualization.small_duct import make_duct
from trocar.services.mechanics.scene import ForcepsScene
from trocar.services.visualization import codec
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape
from trocar.services.visualization.render_pipe import FRAME, HELLO, RENDER, Splitter, pack

pytestmark = [
    pytest.mark.skipif(find_spec("pyvista") is None, reason="pyvista is not installed (extra `view`)"),
    pytest.mark.skipif(ctypes.util.find_library("EGL") is None, reason="no libEGL here: apt-get install libegl1"),
]


def a_scene() -> tuple[PictureLayout, Picture]:
    mesh = make_duct().mesh
    rest = mesh.vertices_m.astype(np.float32)
    tool = ToolShape("left", (0.02, 0.0, 0.15), 2.5e-3, ForcepsScene().drawn(), 15e-3, 1e-3)
    layout = PictureLayout(1, "test", rest, mesh.triangles, 5e-4, (), (), 10, 8e-4, (tool,))
    line = np.linspace([0.06, 0.0, 0.0], [0.03, 0.0, 0.0], 10, dtype=np.float32)
    pose = np.array([[0.02, 0.0, 0.02, 0.7071, 0.0, 0.7071, 0.0]], np.float32)  # shaft straight down
    picture = Picture(1, 1, 0, 0, rest, line, pose, np.array([0.4], np.float32), np.zeros((1, 3), np.float32))
    return layout, picture


def render(*messages: bytes) -> list[bytes]:
    """Return what the worker answers; a worker that dies fails the test."""
    done = subprocess.run(
        [sys.executable, "-m", "trocar.services.visualization.render_worker"],
        input=b"".join(messages), capture_output=True, timeout=500,
    )  # fmt: skip
    assert done.returncode == 0, f"the worker ended with {done.returncode}: {done.stderr.decode()[-2000:]}"
    return [image for _, image in Splitter().feed(done.stdout)]


@pytest.mark.parametrize("size", [1, 4, 5, 7, 1000])
def test_messages_are_whole_however_they_arrive(size: int) -> None:
    sent = [(FRAME, b"abc"), (HELLO, b""), (RENDER, bytes(300))]
    stream, splitter = b"".join(pack(*each) for each in sent), Splitter()
    parts = [stream[k : k + size] for k in range(0, len(stream), size)]
    assert [each for part in parts for each in splitter.feed(part)] == sent


def pixels(data: bytes) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)


_SURFACES = """
import sys
import numpy as np
import pyvista as pv
from trocar.services.visualization import codec
from trocar.services.visualization.drawn_bodies import DrawnCatheter

catheter = DrawnCatheter(pv.Plotter(off_screen=True), codec.decode_hello(sys.argv[1]))
catheter.update(np.linspace([0.06, 0.0, 0.0], [0.03, 0.0, 0.0], 10, dtype=np.float32))
for _, rod in catheter.rods:
    points = rod._surface.points
    print(points[:, 0].min(), points[:, 0].max(), np.hypot(*points.T[1:]).max())
"""


def test_beyond_the_tip_of_the_catheter_its_wire_is_drawn_and_it_is_as_thin_as_that():
    layout = replace(a_scene()[0], n_wire_segments=3, wire_radius_m=0.3e-3)
    done = subprocess.run(
        [sys.executable, "-c", _SURFACES, codec.encode_hello(layout)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    drawn = np.array([line.split() for line in done.stdout.splitlines()], float)
    ends_m = [(0.04, 0.06, 0.8e-3), (0.03, 0.04, 0.3e-3)]  # and rounded tips
    np.testing.assert_allclose(drawn - ends_m, [(-0.8 * radius_m, 0.0, 0.0) for *_, radius_m in ends_m], atol=1e-6)


def _sheared() -> np.ndarray:
    points_m = a_scene()[1].points_m.copy()
    points_m[:, 2] += 0.5 * points_m[:, 0]
    return points_m


def _shown(*shapes: np.ndarray, formats: tuple[bytes, ...] = (b"png",)) -> list[bytes]:
    """Return the pictures of the shapes of a duct that a new renderer draws one after another, in each format."""
    layout, picture = a_scene()
    frames = [pack(FRAME, codec.encode(replace(picture, points_m=points), 0)) for points in shapes]
    asked = b"".join(pack(RENDER, each) for each in formats)
    return render(pack(HELLO, codec.encode_hello(layout).encode()), *(frame + asked for frame in frames))


@pytest.fixture(scope="module")
def fresh() -> list[bytes]:
    """Return the sheared duct of a renderer that has drawn nothing else, as a PNG and as a JPEG."""
    return _shown(_sheared(), formats=(b"png", b"jpeg"))


def test_the_picture_shows_duct_catheter_and_tool_and_follows_the_deformation(fresh):
    at_rest = a_scene()[1].points_m
    flattened = at_rest * np.array([1.0, 1.0, 0.05], np.float32)
    rest, tilted, flat, again = (pixels(image) for image in _shown(at_rest, _sheared(), flattened, at_rest))

    assert rest.shape == (600, 800, 3)
    red, green, blue = rest[..., 0], rest[..., 1], rest[..., 2]
    tissue = (red > 60) & (green < 0.75 * red) & (abs(green - blue) < 0.25 * red)
    assert tissue.mean() > 0.01
    assert red[tissue].std() > 10, "a lit cylinder is darker where it turns away: are there normals?"
    assert ((red > 100) & (green > 0.6 * red) & (blue < 0.5 * red)).mean() > 0.001, "no catheter"
    assert ((red > 150) & (abs(red - blue) < 30)).mean() > 0.001, "no steel"
    assert np.abs(flat - rest).mean() > 1.0
    np.testing.assert_array_equal(again, rest)
    # The same picture as the first of a new renderer: nothing of the shapes before is left, normals included.
    np.testing.assert_array_equal(pixels(fresh[0]), tilted)
    assert np.abs(tilted - rest).mean() > 1.0


def test_a_jpeg_is_a_jpeg(fresh):
    image = fresh[1]
    assert image[:2] == b"\xff\xd8"
    assert pixels(image).shape == (600, 800, 3)
    assert np.abs(pixels(image) - pixels(fresh[0])).mean() < 5.0, "of the same picture"
