"""One fixed frame per topic: for golden bytes, conformance and fuzzing."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from trocar import protocol
from trocar.protocol import TOPICS, Frame, bodies
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.haptics import tool_table
from trocar.protocol.bodies.physics import reaction_table
from trocar.protocol.fields import Field, FieldForm, fields
from trocar.services.runtime.loop.tick_grid import as_state

INCARNATION = 0x1234_5678_9ABC


def _histogram() -> bodies.Histogram:
    return bodies.Histogram(deadline_ns=1_000_000, counts=pack([0, 2, 1], "<i8"), total=3, sum_ns=30, max_ns=20)


def _health(process: str) -> bodies.Health:
    loop = bodies.LoopReport(
        rate_hz=1000.0, ticks=3, misses=1, skipped=0,
        lateness=_histogram(), work=_histogram(), period=_histogram(),
    )  # fmt: skip
    return bodies.Health(
        process=process,
        pid=42,
        state="running",
        uptime_s=1.5,
        loop=loop,
        topics=(bodies.TopicReport(topic="gateway.state", sent=3, refused={"malformed": 1}, age=_histogram()),),
        paths=(bodies.PathLatency(name="servo", latency=_histogram(), answered=2, asked=3),),
        stages=(bodies.StageCost(name="contact", mean_us=12.5, max_us=40.0),),
        realtime=(bodies.RealtimeFact(name="scheduling", asked="FIFO 80", had="FIFO 80", ok=True),),
        gauges={"temperature": 0.25},
    )


def _contacts() -> bodies.ToolContacts:
    return bodies.ToolContacts(
        tick=5,
        tools=tool_table([bodies.ToolState(position_m=(0.1, 0.2, 0.3), port_m=(0.0, 0.0, 0.1), jaw_angle_rad=0.5)]),
        holds=(
            bodies.HeldPoint(
                hold_id=2, tool=0, target_kind=1, target=3, target_weights=(0.5, 0.5, 0.0),
                limit_n=1.5, jaw_angle_rad=0.1,
            ),
        ),
    )  # fmt: skip


def physics_state(tick: int = 5, *tools: bodies.ToolReaction, **changes: msgspec.Struct) -> bodies.PhysicsState:
    """Return a state with a little of everything; `changes` are its duct, catheter or contacts."""
    state = bodies.PhysicsState(
        tick=tick,
        tools=reaction_table(tools),
        duct=bodies.Duct(
            basis_hash="c0ffee", q=pack([1.0, 2.0]), q_rate=pack([0.0, -1.0]),
            load_node=pack([4], "<i4"), load_force_n=pack([[0.0, 0.0, -1.0]]),
        ),
        catheter=bodies.Catheter(
            position_m=pack(np.arange(6.0).reshape(2, 3)), velocity_m_s=pack(np.zeros((2, 3))),
            radius_m=0.8e-3, inserted_length_m=0.02,
        ),
        contacts=bodies.ContactForces(
            kind=pack([0], "|i1"), point_m=pack([[0.1, 0.2, 0.3]]), force_n=pack([[0.0, 0.0, 1.0]]),
            max_penetration_m=1e-5,
        ),
    )  # fmt: skip
    return msgspec.structs.replace(state, **changes)


_BODIES: dict[str, msgspec.Struct] = {
    "gateway.state": bodies.GatewayState(
        tick=5,
        instruments=(
            bodies.InstrumentState(
                name="left", position_m=(0.1, 0.2, 0.3), velocity_m_s=(0.0, 0.5, 0.0), handle_angle_rad=0.4,
                buttons=1, applied_force_n=(0.0, 0.0, 1.0), state="active", force_scale=1.0, model_sequence=9,
                model_age_s=0.0005,
            ),
        ),
    ),
    "haptics.contact_model": bodies.ContactModel.of(
        5,
        0.02,
        (
            bodies.LocalModel(
                force_n=(0.0, 0.0, 1.0), stiffness_n_m=(1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0),
                reference_position_m=(0.1, 0.2, 0.3), grasp_torque_nm=0.05, in_contact=True,
            ),
        ),
    ),
    "haptics.contacts": _contacts(),
    "physics.state": physics_state(
        5, bodies.ToolReaction(force_n=(0.0, 0.0, 1.0), jaw_angle_rad=0.4, contacts=2, holds=1)
    ),
    "supervisor.state": bodies.SupervisorState(
        state="degraded", quality_level=1, reason="physics: miss ratio 2 %, limit 0.1 %",
        processes=(bodies.ProcessReport(name="physics", state="running", pid=42, restarts=1),),
        quality=bodies.QualityReport(
            name="dry", rungs=3, cost_us=250.0, force_error_percent=1.5, motion_error_percent=2.0, lowered=2, raised=1
        ),
    ),
    "visualization.hands": bodies.Hands(
        hands=(bodies.HandTarget(name="left", position_m=(0.1, 0.2, 0.3), roll_rad=1.5, opening=0.7),)
    ),
}  # fmt: skip


def body(name: str) -> msgspec.Struct:
    """Return the fixed body of a topic: one from here, else one that its fields give."""
    if name.endswith(".health"):
        return _health(name.split(".")[0])
    state = as_state(Frame(1, name, 1, 0, 0, 0, 0, True, None)).topic if name.endswith(".moment") else name
    return _BODIES.get(state) or example(TOPICS[name].body)


def example(kind: type[msgspec.Struct]) -> msgspec.Struct:
    """Return a body of `kind` whose fields differ where their types allow it."""
    return kind(**{field.name: _value(field, place) for place, field in enumerate(fields(kind), start=1)})


def _value(field: Field, place: int) -> Any:
    if field.spec is not None:
        shape = tuple(2 if isinstance(length, str) else length for length in field.spec.shape)
        return pack(place + np.arange(np.prod(shape)).reshape(shape), field.spec.dtype)
    item = example(field.body) if field.body else {int: place, float: 0.01 * place, bool: True, str: "a"}[field.item]
    if field.form is FieldForm.FIXED:
        return (item,) * field.count
    if field.form is FieldForm.MANY:
        return (item,)
    return {"a": item} if field.form is FieldForm.MAP else item


def frame(name: str) -> Frame:
    """Return the fixed frame of a topic."""
    return Frame(protocol.PROTOCOL_VERSION, name, TOPICS[name].version, INCARNATION, 7, 2_000, 1_000, True, body(name))
