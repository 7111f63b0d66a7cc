"""The reader for Rerun in docs/examples: what it would log of a sample recording moves, and its blueprint is whole.

Rerun is large and not installed for tests: a stand-in writes down what it is told. In `.ci/run` it is itself tried too.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.by_day import by_day
from tests.made_samples import SUCCESS

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
READER, BLUEPRINT = EXAMPLES / "rerun_scene.py", EXAMPLES / "rerun-blueprint.rbl"
#: The Python that has Rerun, where one has.
VIEWERS = Path(os.environ.get("TROCAR_VIEWERS") or ROOT / "build" / "viewers" / "bin" / "python")
_STANDIN = """
import atexit, json, sys
import numpy as np
logged, times, files = [], [], []
def init(name, spawn): assert (name, spawn) == ("trocar", False)
def save(path): atexit.register(lambda: json.dump({"logged": logged, "times": times, "files": files}, open(path, "w")))
def log_file_from_path(path): files.append(str(path))
def set_time(name, timestamp): times.append(timestamp)
def log(place, what): logged.append([place if isinstance(place, str) else "/".join(place), *what])
def Scalars(value): return "scalar", float(value)
def Mesh3D(vertex_positions, triangle_indices, albedo_factor):
    assert triangle_indices.max() < len(vertex_positions) and len(albedo_factor) == 4
    return "mesh", np.mean(vertex_positions, axis=0).tolist()
def LineStrips3D(strips, colors, radii):
    assert 0.0 < radii < 0.01 and len(colors) == 4
    return "line", np.asarray(strips[-1][-1]).tolist()
"""


with_rerun = pytest.mark.skipif(
    not VIEWERS.exists(), reason="no Rerun: requirements-viewers.lock is to be installed in build/viewers"
)


def run(tmp_path: Path, out: str, python: str = sys.executable) -> Path:
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [python, str(READER), str(SUCCESS), str(tmp_path / out)]
    subprocess.run(command, check=True, env=environment, timeout=500, cwd=tmp_path)
    return tmp_path / out


def test_the_catheter_moves_into_the_duct_between_the_tools(tmp_path: Path) -> None:
    (tmp_path / "rerun.py").write_text(_STANDIN)
    said = json.loads(run(tmp_path, "said.json").read_text())
    assert said["files"] == [str(BLUEPRINT)]
    assert said["times"] == sorted(said["times"])
    assert 1.5 < said["times"][-1] - said["times"][0] < 3.0
    by_place: dict[str, list[object]] = {}
    for place, kind, value in said["logged"]:
        by_place.setdefault(f"{kind} {place}", []).append(value)
    tip = np.array(by_place["line scene/catheter/0"])
    assert np.ptp(tip[:, 0]) > 10e-3, "the tip"
    assert "mesh scene/duct/0" in by_place
    assert {place for place in by_place if place.startswith("line scene/tool")} >= {
        "line scene/tool left/0", "line scene/tool right/0",
    }  # fmt: skip
    assert max(by_place["scalar depth_mm"]) > 15.0  # type: ignore[type-var]
    assert {"scalar force_n/0", "scalar force_n/1"} <= by_place.keys()


def test_the_blueprint_is_whole() -> None:
    """What is in it is packed: only Rerun itself can tell."""
    data = BLUEPRINT.read_bytes()
    assert (data[:4], b"RRF2FOOT" in data[-16:]) == (b"RRF2", True)


@with_rerun
def test_rerun_itself_takes_what_the_reader_draws(tmp_path: Path) -> None:
    scene = run(tmp_path, "scene.rrd", str(VIEWERS))
    rerun("rrd", "verify", str(scene), str(BLUEPRINT))
    told = rerun("rrd", "print", str(scene))
    for place in ("/scene/duct/0", "/scene/catheter/0", "/depth_mm", "/force_n/1"):
        assert place in told


@with_rerun
@pytest.mark.parametrize("name", by_day(["insertion-success"], ["insertion-miss"]))
def test_rerun_itself_finds_recordings_sound_and_decodes_their_scene(tmp_path: Path, name: str) -> None:
    """By the schemas in the file, without a reader of ours."""
    file, out = SUCCESS.with_stem(name), tmp_path / "decoded.rrd"
    rows = re.findall(r"^(\S+) .* (/\S+) ", rerun("mcap", "check", str(file)), re.MULTILINE)
    assert {topic for _, topic in rows} >= {"/scene", "/tf", "/log", "/physics/state", "/gateway/state"}
    assert {status for status, _ in rows} == {"ok"}
    rerun("mcap", "convert", str(file), "-o", str(out))
    told = rerun("rrd", "print", str(out))
    for topic, parts in (("/scene", "foxglove.SceneUpdate:message"), ("/tf", "Transform3D"), ("/log", "TextLog")):
        rows = re.findall(rf"with (\d+) rows .* - {topic} - data columns: \[{parts}", told)
        assert sum(map(int, rows)) > 0, topic


def rerun(*arguments: str) -> str:
    """Return what Rerun's command says."""
    command = [str(VIEWERS), "-m", "rerun", *arguments]
    return subprocess.run(command, check=True, timeout=500, capture_output=True, text=True).stdout
