"""Motions of simulated hands in the rig's scene, derived from its geometry.

A device with the script `SCENE` follows them. Its instrument then has the scene's port, and its simulated arm, which
can be mounted anywhere, is placed so that the motion lies in the middle of its workspace.
"""

from __future__ import annotations

import json

import numpy as np

from trocar.services.gateway.motions.script import SCENE, Motion, draw_back
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import GatewaySettings, InstrumentSettings, Settings, Vector3
from trocar.services.runtime.config.scene_findings import find_in_scene

_MODULE = "trocar.services.scenes.hand_motions"


class SceneHand(Settings):
    """Port and motion of one tool of the scene."""

    port_m: Vector3
    motion: Motion


class SceneHands(Settings):
    """Hands of all tools of the scene, in order."""

    hands: tuple[SceneHand, ...] = ()


def are_called_for(gateway: GatewaySettings) -> bool:
    """Return whether a device of the rig follows the scene's motions."""
    return any(_follows(row) for row in gateway.instruments)


def find_scene_hands(scene: str, overrides: tuple[str, ...] = ()) -> SceneHands:
    """Return the motions of the hands of a scene.

    Raises ConfigError: one sentence, if the scene is invalid.
    """
    return find_in_scene(_MODULE, scene, overrides, _read)


def fitted(row: InstrumentSettings, hand: SceneHand | None) -> InstrumentSettings:
    """Return the instrument with port and mount for its hand in the scene, if it follows the scene."""
    if hand is None or not _follows(row):
        return row
    reached = np.array([_junction_m(point.hip_m, hand) for point in hand.motion.breakpoints])
    x, y, z = (0.5 * (reached.min(axis=0) + reached.max(axis=0))).tolist()
    return row.model_copy(update={"port_m": hand.port_m, "mount": row.mount.model_copy(update={"centre_m": (x, y, z)})})


def _follows(row: InstrumentSettings) -> bool:
    devices = (row.arm, row.grasp) if row.grasp is not None else (row.arm,)
    return any(device.settings.get("script") == SCENE for device in devices)


def _junction_m(point_m: Vector3, hand: SceneHand) -> list[float]:
    value, rate = np.array(point_m), np.zeros(3)
    draw_back(np.array(hand.port_m), hand.motion.beyond_hip_m, value, rate)
    return value.tolist()  # type: ignore[no-any-return]


def _read(text: bytes) -> SceneHands:
    return config.build(SceneHands, {"hands": json.loads(text)}, "hands of the scene")
