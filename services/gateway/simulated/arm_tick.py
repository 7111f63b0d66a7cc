"""One kernel for the whole tick of a simulated arm: script, hand, motors, links, encoders.

In a running rig a call from Python costs three times as much as in a loop (docs/decisions/cost-of-a-tick.md), and
separate kernels were six calls an arm.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.gateway.motions.script import COLUMNS, ROLL, draw_back
from trocar.services.gateway.servo.servo_arrays import READ_ROLL, READ_SIZE, READ_TEMPERATURE
from trocar.services.gateway.simulated.simulated_arm import (
    HAND_SIZE,
    filter_reading,
    hottest,
    place_hand,
    step_links,
    tremble,
)
from trocar.services.gateway.simulated.write_delay import WRITE_SIZE, WRITES
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk


class ArmTick(Struct):
    """The arrays of `script.Player`, `simulated_arm.ArmState` and the driver."""

    times: Annotated[FloatArray, "k"]
    values: Annotated[FloatArray, "k", COLUMNS]
    value: Annotated[FloatArray, COLUMNS]
    rate: Annotated[FloatArray, COLUMNS]
    port: Annotated[FloatArray, 3]
    beyond_m: float
    tremor_m: float
    stand: Annotated[FloatArray, 8]
    hand: Annotated[FloatArray, HAND_SIZE]
    angles: Annotated[FloatArray, 3]
    rates: Annotated[FloatArray, 3]
    heat: Annotated[FloatArray, 2, 3]
    force: Annotated[FloatArray, 3]
    writes: Annotated[FloatArray, WRITES, WRITE_SIZE]
    given: Annotated[FloatArray, 1]
    work: Annotated[FloatArray, 4, 3]
    jacobian: Annotated[FloatArray, 3, 3]
    measured: Annotated[FloatArray, 3]
    filter: Annotated[FloatArray, 2, 3]
    coefficients: Annotated[FloatArray, 5]
    centre: Annotated[FloatArray, 3]
    reading: Annotated[FloatArray, READ_SIZE]
    friction: float = 1.0
    wait_s: float = 0.0  # until a force acts that is written now


arm_tick_at = reader(ArmTick)


@kernel
def tick_arm(address: Address[ArmTick], script_s: float, time_s: float) -> None:
    """Move the hand to its script's pose at `script_s`, advance the arm by a tick, and read it.

    The tremor depends on `time_s`, which continues when a script starts again.
    """
    tick = arm_tick_at(address)
    minimum_jerk(tick.times, tick.values, script_s, tick.value, tick.rate)
    if tick.beyond_m > 0.0:
        draw_back(tick.port, tick.beyond_m, tick.value, tick.rate)
    place_hand(tick.value, tick.rate, tick.stand, tick.hand)
    if tick.tremor_m > 0.0:
        tremble(tick.hand, tick.tremor_m, time_s)
    step_links(
        tick.angles,
        tick.rates,
        tick.heat,
        tick.force,
        tick.wait_s,
        tick.hand,
        tick.friction,
        tick.writes,
        tick.given,
        tick.work,
        tick.jacobian,
    )
    filter_reading(tick.angles, tick.measured, tick.filter, tick.coefficients, tick.centre, tick.reading)
    tick.reading[READ_TEMPERATURE] = hottest(tick.heat)
    tick.reading[READ_ROLL] = tick.value[ROLL]
