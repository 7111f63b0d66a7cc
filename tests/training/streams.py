"""Made-up attempts: what the bus would say of hands that do this and that, moment by moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from trocar.protocol import bodies
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.haptics import tool_table
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.training.scenario import Goal, Scenario
from trocar.services.training.site import Site

MOUTH = np.array([0.04, 0.0, 0.0])
SITE = Site(
    mouth_m=(0.04, 0.0, 0.0), inward=(-1.0, 0.0, 0.0), mouth_radius_m=4e-3, eye_m=(0.04, -0.2, 0.0),
    looks_at_m=(0.04, 0.0, 0.0), basis_hash="made up", rim_gain=(1.0,),
)  # fmt: skip
CLIP = MOUTH + np.array([-6e-3, 0.0, 0.0])
CLIPPED_SITE = msgspec.structs.replace(SITE, clip_m=tuple(CLIP), clip_reach_m=8e-3, clip_inward=(-1.0, 0.0, 0.0))
SCENARIO = Scenario(name="made-up", title="Made up", scene="insertion", goal=Goal(depth_m=0.012))
PORTS = (0.075, -0.06, 0.12), (0.01, 0.07, 0.11)
N, SEGMENT_M, HELD = 40, 2e-3, 26
#: Arc over chord of a wave of one period, by its height over its length.
WAVE_HEIGHTS = np.linspace(0.0, 0.4, 41)
_SLOPES = np.pi * np.outer(WAVE_HEIGHTS, np.sin(2.0 * np.pi * (np.arange(400) + 0.5) / 400))
WAVE_RATIOS = np.sqrt(1.0 + _SLOPES**2).mean(axis=1)
TICKS = 20  # 50 Hz: so often does the recorder sample physics

Channel = list[tuple[float, float]]
#: A good attempt of 16 seconds. Each channel is its breakpoints: linear between them, constant before and after.
#: Lengths in m, forces in N; holds, grips and the pedal are on above a half.
GOOD: dict[str, Channel] = {
    "gap": [(1.0, 6e-3), (2.0, 1e-3)],  # of the tip before the mouth, while nothing is inserted
    "inserted": [(2.5, 0.0), (8.0, 15e-3)],
    "outside": [(0.0, 0.0)],  # the tip has left the lumen where it is
    "hold": [(0.499, 0.0), (0.5, 1.0), (14.5, 1.0), (14.501, 0.0)],
    "grip": [(0.299, 0.0), (0.3, 1.0), (8.999, 1.0), (9.0, 0.0), (9.199, 0.0), (9.2, 1.0)],
    "traction": [(0.0, 0.3)],
    "push": [(2.5, 0.0), (2.6, 0.2), (8.0, 0.2), (8.1, 0.0)],
    "catheter_squeeze": [(0.0, 0.6)],
    "duct_squeeze": [(0.0, 0.5)],
    "clip": [(9.2, 0.0), (9.4, 0.8)],
    "clipped": [(0.0, 0.0)],  # by a clip on the duct
    "clip_drags": [(0.0, 0.0)],  # along it, on either side
    "rim": [(0.0, 0.1)],
    "tip": [(2.4, 0.0), (2.45, 0.05), (2.5, 0.0)],
    "wall": [(2.5, 0.0), (8.0, 0.2)],
    "flush": [(0.999, 0.0), (1.0, 1.0), (1.799, 1.0), (1.8, 0.0),
              (11.999, 0.0), (12.0, 1.0), (13.999, 1.0), (14.0, 0.0)],
    "opening": [(0.0, 1.0)],
    "penetration": [(0.0, 1e-5)],
    "bend": [(0.0, 0.0)],  # curvature in 1/m, beyond the held point
    "buckle": [(0.0, 1.0)],  # arc over chord of what is between hand and mouth
    "turn": [(0.0, 0.0)],  # of the tip in the lumen, rad
    "slide": [(0.0, 0.0)],
    "off_view": [(0.0, 0.1)],
    "apart": [(0.0, 0.03)],  # of the shafts
    "jaw": [(14.5, 0.2), (14.501, 0.6)],
    "blind": [(0.0, 0.0)],
}  # fmt: skip


def _from_mouth(x: float, y: float, z: float) -> np.ndarray:
    return MOUTH + np.array([x, y, z])


def changed(changes: Mapping[str, Channel]) -> dict[str, Channel]:
    """Return the good attempt with other channels."""
    assert changes.keys() <= GOOD.keys()
    return GOOD | dict(changes)


def messages(
    channels: Mapping[str, Channel], seconds: float = 16.0, first_tick: int = 1000
) -> Iterator[tuple[str, int, msgspec.Struct]]:
    """Yield topic, time in ns and body of the fast frames, every so many `TICKS`."""
    for tick in range(first_tick, first_tick + round(seconds * 1000), TICKS):
        now_s = (tick - first_tick) * 1e-3
        at = {name: float(np.interp(now_s, *zip(*points, strict=True))) for name, points in channels.items()}
        yield from _frames(tick, at)


def _frames(tick: int, at: Mapping[str, float]) -> Iterator[tuple[str, int, msgspec.Struct]]:
    catheter = _catheter(at)
    held = catheter[HELD]
    across = at["apart"] * np.array([0.0, 0.12, 0.06]) / math.hypot(0.12, 0.06)  # of the first shaft
    positions = [held + np.array([at["slide"], 0.0, 0.0]), held + across]
    ports = [PORTS[0], tuple(np.add(PORTS[0], across))]
    if at["apart"] >= 0.03:
        positions[1], ports[1] = _from_mouth(-12e-3, 0.0, 2e-3), PORTS[1]
    if at["off_view"] > 0.2:  # the second hand wanders off to the side
        tip = _from_mouth(-0.2 * math.tan(at["off_view"]), 0.0, 0.0)
        positions[1] = tip + (ports[1] - tip) * 12e-3 / np.linalg.norm(ports[1] - tip)
    forces = [np.array([at["push"], 0.0, 0.0]), np.array([-at["traction"], 0.0, at["blind"]])]
    jaws, time_ns = (at["jaw"], 0.3), tick * 1_000_000
    yield "gateway.state", time_ns, _gateway(tick, at, positions, ports, jaws)
    yield "haptics.contacts", time_ns, _contacts(tick, at, positions, ports, jaws)
    reactions = [
        bodies.ToolReaction(
            force_n=tuple(force),
            position_m=tuple(place),
            proxy_position_m=tuple(place),
            jaw_angle_rad=jaw,
            grasp_torque_nm=torque,
        )
        for force, place, jaw, torque in zip(forces, positions, jaws, (0.0, 5e-3 * (at["grip"] > 0.5)), strict=True)
    ]
    yield "physics.state", time_ns, bodies.PhysicsState(
        tick=tick,
        tools=reaction_table(reactions),
        duct=bodies.Duct(
            basis_hash="made up", q=pack([SITE.mouth_radius_m * (math.sqrt(at["opening"]) - 1.0)]), q_rate=pack([0.0]),
            load_node=pack([], "<i4"), load_force_n=pack(np.zeros((0, 3))),
        ),
        catheter=bodies.Catheter(
            position_m=pack(catheter), velocity_m_s=pack(np.zeros((N, 3))), radius_m=0.8e-3,
            inserted_length_m=0.0 if at["outside"] > 0.5 else at["inserted"],
        ),
        contacts=_forces(at, catheter, _between_jaws(positions[1], ports[1])),
    )  # fmt: skip


def _catheter(at: Mapping[str, float]) -> np.ndarray:
    """Return a straight line along x into the mouth, with what is asked for of turn, bend and buckle."""
    tip_x = MOUTH[0] - at["inserted"] if at["inserted"] > 0.0 else MOUTH[0] + at["gap"]
    line = np.zeros((N, 3))
    line[:, 0] = tip_x + SEGMENT_M * np.arange(N)[::-1]
    if at["turn"]:
        line[-7:] = _arc(line[-7], -1.0, np.full(6, at["turn"] / 6))
    if at["bend"]:  # behind the hand
        line[4::-1] = _arc(line[4], 1.0, np.array([0.0, *np.full(3, 2.0 * math.atan(0.5 * SEGMENT_M * at["bend"]))]))
    if at["buckle"] > 1.0:  # a wave from the hand to the mouth
        free = (line[:, 0] - MOUTH[0]) / (line[HELD, 0] - MOUTH[0])
        height_m = np.interp(at["buckle"], WAVE_RATIOS, WAVE_HEIGHTS) * (line[HELD, 0] - MOUTH[0])
        line[:, 2] = 0.5 * height_m * (1.0 - np.cos(2.0 * np.pi * np.clip(free, 0.0, 1.0)))
    return line


def _arc(start: np.ndarray, way: float, turns: np.ndarray) -> np.ndarray:
    """Return points a segment apart from `start` along x, each segment turned from the one before by `turns`."""
    angles = np.cumsum(turns)
    steps = SEGMENT_M * np.column_stack([way * np.cos(angles), np.sin(angles), np.zeros(len(turns))])
    return np.vstack([start, start + np.cumsum(steps, axis=0)])


def _gateway(tick: int, at: Mapping[str, float], positions: Any, ports: Any, jaws: Any) -> bodies.GatewayState:
    return bodies.GatewayState(
        tick=tick,
        instruments=tuple(
            bodies.InstrumentState(
                name=name, position_m=tuple(positions[k]), port_m=tuple(ports[k]), handle_angle_rad=jaws[k],
                velocity_m_s=(0.01, 0.0, 0.0), buttons=2 * (k == 0 and at["flush"] > 0.5),
            )
            for k, name in enumerate(("right", "left"))
        ),
    )  # fmt: skip


def _contacts(tick: int, at: Mapping[str, float], positions: Any, ports: Any, jaws: Any) -> bodies.ToolContacts:
    hold = bodies.HeldPoint(
        hold_id=7, tool=0, target_kind=1, target=HELD, target_weights=(1.0, 0.0, 0.0), limit_n=2.0, jaw_angle_rad=0.2
    )
    return bodies.ToolContacts(
        tick=tick,
        tools=tool_table(
            [
                bodies.ToolState(position_m=tuple(positions[k]), port_m=tuple(ports[k]), jaw_angle_rad=jaws[k])
                for k in range(2)
            ]
        ),
        holds=(hold,) if at["hold"] > 0.5 else (),
    )


def _between_jaws(position: np.ndarray, port: Any) -> np.ndarray:
    along = position - np.array(port)
    return np.asarray(position + 6e-3 * along / np.linalg.norm(along))


def _forces(at: Mapping[str, float], catheter: np.ndarray, between_jaws: np.ndarray) -> bodies.ContactForces:
    """Return pairs of opposite forces for squeezes, and one force each for loads on rim, tip and wall."""
    z = np.array([0.0, 0.0, 1.0])
    rows: list[tuple[int, np.ndarray, np.ndarray]] = []
    if at["grip"] > 0.5:
        rows += [(0, between_jaws, at["duct_squeeze"] * z), (0, between_jaws, -at["duct_squeeze"] * z)]
        rows += [(0, MOUTH, at["clip"] * z), (0, MOUTH, -at["clip"] * z)]
    if at["hold"] > 0.5:
        rows += [(1, catheter[HELD], at["catheter_squeeze"] * z), (1, catheter[HELD], -at["catheter_squeeze"] * z)]
    if at["clipped"] > 0.0:
        drag = np.array([at["clip_drags"], 0.0, 0.0])
        rows += [(2, CLIP, at["clipped"] * z - drag), (2, CLIP, -at["clipped"] * z - drag)]
    rows += [(2, catheter[-1], at["tip"] * z), (2, _from_mouth(-5.5e-3, 4e-3, 0.0), at["wall"] * z)]
    rows += [(2, _from_mouth(0.0, 4e-3, 0.0), at["rim"] * z)]
    kinds, points, forces = zip(*rows, strict=True)
    return bodies.ContactForces(
        kind=pack(kinds, "|i1"), point_m=pack(points), force_n=pack(forces), max_penetration_m=at["penetration"]
    )
