"""The view protocol: what the server packs is what a client unpacks, in Python and in the page's JavaScript."""

import base64
import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.scene import ForcepsScene, ProbeScene
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.visualization import codec
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape
from trocar.services.visualization.web import build

_MILLIMETRES = 1000.0


def a_layout(n: int = 6, m: int = 4) -> PictureLayout:
    random = np.random.default_rng(1)
    left = ToolShape("left", (0.1, 0.0, 0.3), 2.5e-3, ForcepsScene().drawn(), 15e-3, 1e-3)
    tools = (left, ToolShape("right", (0.1, 0.2, 0.3), 2.5e-3, ProbeScene().drawn()))
    return PictureLayout(
        epoch=3,
        scene="test",
        rest_m=random.normal(size=(n, 3)).astype(np.float32),
        triangles=random.integers(0, n, size=(2 * n, 3)).astype(np.int32),
        thickness_m=0.5e-3,
        mouth=(0, 1),
        clamped=(2, 3),
        n_particles=m,
        catheter_radius_m=0.8e-3,
        tools=tools,
        n_wire_segments=1,
        wire_radius_m=0.3e-3,
        bars=(WallBar((0, 1, 2), (0.2, 0.3, 0.5), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (9e-3, 1.5e-3, 0.8e-3)),),
        stone_radii_m=(2e-3, 1e-3),
    )


def a_picture(layout: PictureLayout) -> Picture:
    random = np.random.default_rng(2)

    def numbers(*shape: int) -> np.ndarray:
        return random.normal(size=shape).astype(np.float32)

    k = len(layout.tools)
    return Picture(
        layout.epoch, 2**40 + 1, 12345, 10**15, numbers(len(layout.rest_m), 3), numbers(layout.n_particles, 3),
        numbers(k, 7), numbers(k), numbers(k, 3), 0.0125,
        numbers(len(layout.stone_radii_m), 3),
    )  # fmt: skip


def test_a_layout_comes_back_as_it_was():
    layout = a_layout()
    back = codec.decode_hello(codec.encode_hello(layout))
    np.testing.assert_array_equal(back.rest_m, layout.rest_m)
    np.testing.assert_array_equal(back.triangles, layout.triangles)
    without = {"rest_m": None, "triangles": None}  # arrays have no truth value when they are compared
    assert replace(back, **without) == replace(layout, **without)


def test_a_picture_comes_back_as_it_was():
    layout = a_layout()
    picture = a_picture(layout)
    back, sent_ns = codec.decode(codec.encode(picture, 99), layout)
    assert (back.epoch, back.sequence, back.tick, back.origin_ns, sent_ns) == (3, 2**40 + 1, 12345, 10**15, 99)
    for name in ("points_m", "centreline_m", "poses", "jaw_rad", "force_n", "stones_m"):
        np.testing.assert_array_equal(getattr(back, name), getattr(picture, name))
    assert back.inserted_length_m == np.float32(0.0125)


def test_a_hello_that_was_kept_before_stones_were_drawn_has_none():
    hello = json.loads(codec.encode_hello(replace(a_layout(), stone_radii_m=())))
    del hello["stones"]
    assert codec.decode_hello(json.dumps(hello)).stone_radii_m == ()


def test_a_frame_of_another_layout_is_refused():
    layout = a_layout()
    data = codec.encode(a_picture(layout), 0)
    with pytest.raises(ValueError, match="its layout says"):
        codec.decode(data, a_layout(m=5))


def test_a_hello_of_another_protocol_is_refused():
    hello = json.loads(codec.encode_hello(a_layout())) | {"protocol": "trocar-view/9"}
    with pytest.raises(ValueError, match="trocar-view/9"):
        codec.decode_hello(json.dumps(hello))


def test_a_frame_is_small():
    layout = a_layout(n=500, m=100)
    assert len(codec.encode(a_picture(layout), 0)) < 7400


_READ = """
import { decodeFrame, decodeHello } from "./src/view/protocol.js";
const [hello, frame] = JSON.parse(process.argv[1]);
const layout = decodeHello(JSON.parse(hello));
const bytes = Uint8Array.from(Buffer.from(frame, "base64"));
const { sequence, sent_ns, origin_ns, ...rest } = decodeFrame(bytes.buffer, layout);
const plain = Object.fromEntries(Object.entries(rest).map(([k, v]) => [k, v.buffer ? [...v] : v]));
console.log(JSON.stringify({ ...plain, sequence: String(sequence), sent_ns: String(sent_ns),
  triangles: [...layout.triangles], rest: [...layout.rest], rods: layout.rods, radii: layout.stones,
  short: decodeFrame(bytes.buffer.slice(0, -4), layout) }));
"""


def test_the_page_reads_what_the_server_writes():
    try:
        node, _ = build.find_node()
    except build.BuildError as error:
        pytest.skip(str(error))
    layout = a_layout()
    picture = a_picture(layout)
    message = json.dumps([codec.encode_hello(layout), base64.b64encode(codec.encode(picture, 77)).decode()])
    done = subprocess.run(
        [node, "--input-type=module", "-e", _READ, message], cwd=build.WEB, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert (seen["sequence"], seen["sent_ns"], seen["tick"]) == (str(2**40 + 1), "77", 12345)
    assert seen["triangles"] == layout.triangles.ravel().tolist()
    rods = [(range(4)[part], radius_m * _MILLIMETRES) for part, radius_m in layout.rods()]
    assert [(range(rod["from"], rod["to"] + 1), rod["radius"]) for rod in seen["rods"]] == rods
    np.testing.assert_allclose(seen["rest"], layout.rest_m.ravel() * _MILLIMETRES, rtol=1e-6)
    np.testing.assert_allclose(seen["points"], picture.points_m.ravel() * _MILLIMETRES, rtol=1e-6)
    np.testing.assert_allclose(seen["centreline"], picture.centreline_m.ravel() * _MILLIMETRES, rtol=1e-6)
    np.testing.assert_allclose(seen["jaws"], picture.jaw_rad, rtol=1e-6)
    np.testing.assert_allclose(seen["forces"], picture.force_n.ravel(), rtol=1e-6)
    poses = picture.poses * np.array([_MILLIMETRES] * 3 + [1.0] * 4)
    np.testing.assert_allclose(seen["poses"], poses.ravel(), rtol=1e-6)
    np.testing.assert_allclose(seen["stones"], picture.stones_m.ravel() * _MILLIMETRES, rtol=1e-6)
    assert seen["radii"] == pytest.approx([2.0, 1.0])
    assert seen["inserted_mm"] == pytest.approx(12.5)
    assert seen["short"] is None
