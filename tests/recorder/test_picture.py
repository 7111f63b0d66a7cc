"""What others see of a recording: Foxglove's schemas decode the scene, and it moves; attachments say how it was run."""

from __future__ import annotations

import io
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader

from tests.physics.conftest import SMALL
from tests.protocol import samples
from trocar.protocol.arrays import pack
from trocar.protocol.bodies import Catheter, Duct, GatewayState, InstrumentState
from trocar.services.files.cache_directory import cache_directory
from trocar.services.recorder import attachments
from trocar.services.recorder.picture import PictureRecorder
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.reader import read_extras
from trocar.services.recordings.repair import repair
from trocar.services.recordings.scene_update import LOG, SCENE, TRANSFORMS, SceneDrawing
from trocar.services.runtime.config.config import load_rig
from trocar.services.scenes import load_duct, load_scene

MS = 1_000_000


@pytest.fixture(scope="module")
def drawing() -> SceneDrawing:
    scene = load_scene(SMALL)
    return SceneDrawing(scene, load_duct(scene, cache_directory(), lambda stage, share: None))


def _recording(path: Path, drawing: SceneDrawing) -> Path:
    """Record half a second in which the duct swings, a tool comes down and the rig degrades."""
    writer, duct = RecordingWriter(path, {}), drawing._surface.duct
    picture = PictureRecorder(writer.to_wall_ns)
    picture.drawing = drawing
    line = pack(np.arange(63.0).reshape(21, 3) * 1e-3)
    for tick in range(500):
        q = np.zeros(duct.basis.n_modes)
        q[0] = 1e-4 * tick
        state = samples.physics_state(
            tick,
            duct=Duct(basis_hash=duct.basis.content_hash, q=pack(q), q_rate=pack(q), load_node=pack([5], "<i4"),
                      load_force_n=pack([[0.0, 0.0, -0.1]])),
            catheter=Catheter(position_m=line, velocity_m_s=line, radius_m=0.8e-3),
        )  # fmt: skip
        tool = InstrumentState(name="left", position_m=(0.02, 0.0, 0.01 - 1e-5 * tick), port_m=(0.0, 0.0, 0.1))
        for name, body in (("physics.state", state), ("gateway.state", GatewayState(tick=tick, instruments=(tool,)))):
            frame = samples.frame(name)
            picture.see(msgspec.structs.replace(frame, sequence=tick, sent_ns=tick * MS, body=body))
        picture.see(samples.frame("supervisor.state"))
        for drawn in picture.draw(tick * MS):
            writer.draw(*drawn)
    writer.close()
    return path


def test_the_schemas_of_foxglove_decode_a_scene_that_moves(tmp_path: Path, drawing: SceneDrawing) -> None:
    path = _recording(tmp_path / "a.mcap", drawing)
    with path.open("rb") as file:
        read = [(s.name, c.topic, m.data) for s, c, m in make_reader(file).iter_messages() if s is not None]
    scenes = [SceneUpdate.FromString(data) for name, topic, data in read if topic == SCENE]
    assert {(name, topic) for name, topic, _ in read} == {
        ("foxglove.SceneUpdate", SCENE), ("foxglove.FrameTransforms", TRANSFORMS), ("foxglove.Log", LOG),
    }  # fmt: skip
    assert len(scenes) == 5, "ten a second"
    entities = [{entity.id: entity for entity in scene.entities} for scene in scenes]
    assert set(entities[0]) == {"duct", "catheter", "tool left"}
    mesh, (triangles,) = drawing._surface.duct.mesh, entities[-1]["duct"].triangles
    assert list(triangles.indices) == mesh.triangles.ravel().tolist()
    drawn = np.array([(p.x, p.y, p.z) for p in triangles.points])
    assert np.max(np.abs(drawn - drawing._surface.points_m)) <= 2.0**-18 + 1e-9
    assert np.max(np.abs(drawn - mesh.vertices_m)) > 1e-4
    (line,) = entities[-1]["catheter"].lines
    assert (len(line.points), line.thickness) == (21, pytest.approx(1.6e-3))
    assert len(entities[-1]["tool left"].lines) == 3
    heights = [FrameTransforms.FromString(d).transforms[0].translation.z for _, topic, d in read if topic == TRANSFORMS]
    assert heights == sorted(heights, reverse=True)
    (line_of_log,) = [Log.FromString(data) for _, topic, data in read if topic == LOG]
    assert line_of_log.level == Log.WARNING
    assert line_of_log.message.startswith("degraded: physics")


def test_it_carries_how_it_was_run(tmp_path: Path, drawing: SceneDrawing) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {"rig": "stub"})
    for attached in attachments.settings(load_rig("stub"), str(SMALL), ("duct.n_modes=20",)):
        writer.attach(*attached)
    writer.attach(*attachments.surface(drawing._surface.duct))
    writer.write(samples.frame("gateway.state"))
    writer.close()
    metadata, found = read_extras(writer.path)
    assert metadata["trocar"]["rig"] == "stub"
    devices = {"devices/phantom_premium_1_5.yaml", "devices/grasp_odrive.yaml"}
    assert set(found) == {"scene.yaml", "rig.yaml", "duct.npz"} | devices
    assert yaml.safe_load(found["scene.yaml"])["duct"]["n_modes"] == 20
    mesh = np.load(io.BytesIO(found["duct.npz"]))
    np.testing.assert_array_equal(mesh["vertices_m"], drawing._surface.duct.mesh.vertices_m)
    assert repair(writer.path) is None


def test_five_lines_read_it(tmp_path: Path, drawing: SceneDrawing) -> None:
    """Those of docs/how-to/recordings.md."""
    path = _recording(tmp_path / "a.mcap", drawing)
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "recordings.md").read_text()
    code = page.partition("```python\n")[2].partition("```")[0]
    said: list[object] = []
    exec(code.replace("recording.mcap", str(path)), {"print": lambda *words: said.append(words)})
    assert len(said) == 5
    assert len([line for line in code.splitlines() if line]) == 5
