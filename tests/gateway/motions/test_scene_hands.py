"""Simulated devices do what the rig's scene is for, where the scene has its ports."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.gateway.instruments.instrument import build_instruments
from trocar.services.gateway.motions import scene_hands
from trocar.services.gateway.motions.scene_hands import find_scene_hands
from trocar.services.gateway.motions.script import HANDLE, HIP, ROLL, Player
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.runtime.config import config, scene_findings
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene, load_surface
from trocar.services.scenes.hands import STROKE_M, hands_of

PACE = 0.25


@pytest.fixture
def kept_here(monkeypatch, tmp_path):
    """An empty cache; other tests share what was found, in the cache of all tests."""
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(tmp_path))


@pytest.mark.parametrize("name", ["default", "pinch"])
def test_a_simulated_hand_moves_as_the_hands_of_the_scene(name, tmp_path):
    scene = load_scene(name, ["duct.curvature_1_m=8.0"])
    mesh = load_surface(scene, tmp_path)
    hands = hands_of(place_catheter(scene, mesh), mesh)
    found = find_scene_hands(name, ("duct.curvature_1_m=8.0",)).hands
    inputs = ToolInputs()
    for tool, hand in enumerate(found):
        if hands.motions[tool] is None:
            assert len(hand.motion.breakpoints) == 1
            continue
        player = Player(hand.motion, False, hand.port_m, PACE)
        for time_s in np.linspace(0.0, hands.motions[tool].time_s[-1], 30):
            hands.write_inputs(float(time_s), inputs)
            player.sample(float(time_s) / PACE)
            np.testing.assert_allclose(player.value[HIP : HIP + 3], inputs.position_m[tool], atol=1e-9)
            assert player.value[ROLL] == pytest.approx(inputs.roll_rad[tool])
            assert player.value[HANDLE] == pytest.approx(inputs.jaw_angle_rad[tool])


def test_then_the_catheter_is_moved_to_and_fro_for_a_minute_and_the_other_hand_holds_on():
    left, right = find_scene_hands("default").hands
    player = Player(left.motion, False, left.port_m, 0.2)
    assert player.lasts_s > 60.0
    points = np.array([point.hip_m for point in left.motion.breakpoints])
    assert np.linalg.norm(points[-2] - points[-1]) == pytest.approx(STROKE_M)
    assert right.motion.breakpoints[-1].time_s < 1.0


def test_what_the_hands_of_a_scene_do_is_found_once_and_anew_when_the_scene_is_another(kept_here, monkeypatch):
    found = find_scene_hands("default")
    monkeypatch.setattr(scene_findings.subprocess, "run", None)
    assert find_scene_hands("default") == found
    with pytest.raises(TypeError):
        find_scene_hands("default", ("duct.length_m=0.05",))


def test_a_cache_that_cannot_be_written_is_done_without(monkeypatch, tmp_path):
    (tmp_path / "scenes").touch()
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(tmp_path))
    assert len(find_scene_hands("default").hands) == 2


def test_what_a_crash_left_of_a_kept_file_is_found_anew(kept_here, monkeypatch, tmp_path):
    found = find_scene_hands("default")
    (file,) = (tmp_path / "scenes").iterdir()
    again = iter([file.read_bytes()] * 2)
    monkeypatch.setattr(scene_findings, "_found", lambda *_: next(again))
    for left in ("", '[{"port_m": [0.0, 0.0, 0.0]}]'):
        file.write_text(left)
        assert find_scene_hands("default") == found
    assert find_scene_hands("default") == found, "kept"
    assert list(again) == [], "found twice"


def test_port_and_arm_are_where_the_scene_wants_them():
    overrides = ("forceps.0.port_position_m=[0.02, 0.15, 0.0]",)
    hands = find_scene_hands("default", overrides).hands
    instruments = build_instruments(config.load_rig("stub").gateway, hands=hands)
    arm = instruments[0].arm
    arm.open()
    for k in range(20):
        instruments[0].read(1_000_000 * (k + 1))
    state = instruments[0].state()
    assert state.port_m == (0.02, 0.15, 0.0)
    player = Player(hands[0].motion, False, hands[0].port_m)
    assert state.position_m == pytest.approx(player.value[HIP : HIP + 3], abs=1e-3)


def test_an_instrument_that_follows_no_scene_stays_where_the_rig_has_it():
    rig = config.load_rig("stub", ["gateway.instruments.0.arm.settings.script=stroke",
                                   "gateway.instruments.0.grasp.settings.script=stroke"])  # fmt: skip
    hands = find_scene_hands("default", ("forceps.0.port_position_m=[0.02, 0.15, 0.0]",)).hands
    assert scene_hands.fitted(rig.gateway.instruments[0], hands[0]) == rig.gateway.instruments[0]
    assert scene_hands.are_called_for(rig.gateway)
    assert not scene_hands.are_called_for(config.load_rig("hardware").gateway)


def test_a_scene_whose_surface_is_missing_is_one_sentence():
    with pytest.raises(ConfigError, match=r"anatomy.yaml: duct.mesh_file: /nowhere.stl: no such file$"):
        find_scene_hands("anatomy", ("duct.mesh_file=/nowhere.stl",))


def test_what_a_surface_file_says_counts(kept_here, monkeypatch, tmp_path):
    said = iter([b"one", b"two"])
    monkeypatch.setattr(scene_findings, "_found", lambda *_: next(said))
    surface, override = tmp_path / "a.stl", (f"duct.mesh_file={tmp_path}/a.stl",)
    for text, found in (("solid", b"one"), ("solid", b"one"), ("sphere", b"two"), ("solid", b"one")):
        surface.write_text(text)
        assert scene_findings.find_in_scene("trocar.services.scenes.hand_motions", "default", override, bytes) == found
