"""Columns of the servo's flat float64 arrays, which pass into a kernel without being unpacked."""

from __future__ import annotations

from trocar.protocol.bodies.haptics import MODEL_CONTACT, MODEL_GRASP_B, MODEL_GRASP_K
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

# Readings of an arm in its own frame: z up, origin at the middle of its workspace.
READ_POSITION, READ_VELOCITY, READ_TEMPERATURE, READ_ROLL, READ_SIZE = 0, 3, 6, 7, 8

# Readings of a handle.
HANDLE_ANGLE, HANDLE_RATE, HANDLE_SIZE = 0, 1, 2

# Limits of an arm, its encoder's count at the tip, m, and its friction, N.
(
    LIMIT_FORCE, LIMIT_CONTINUOUS_FORCE, LIMIT_RATE, LIMIT_TORQUE, LIMIT_TORQUE_RATE,
    LIMIT_COUNT, LIMIT_FRICTION, LIMIT_SIZE,
) = range(8)  # fmt: skip

# The present tick: time since the last, age of the model and of its end, engagement of arm and handle, temperature,
# and of the hands of all other instruments the energy that they have put in, and what they may get back in this tick.
NOW_DT, NOW_AGE, NOW_TTL, NOW_GAIN, NOW_GRASP_GAIN, NOW_TEMPERATURE, NOW_OTHERS, NOW_RESERVED, NOW_SIZE = range(9)

# State of the servo between ticks; `energy_bound` defines the four energies and the anchor.
MEMORY_FORCE, MEMORY_POSITION, MEMORY_WAY, MEMORY_ANCHOR = 0, 3, 6, 9
(
    MEMORY_ENERGY, MEMORY_BY_STEPS, MEMORY_AT_ANCHOR, MEMORY_HOT, MEMORY_DEMAND, MEMORY_REFUSED, MEMORY_SCALE,
    MEMORY_STIFFNESS, MEMORY_RESERVED, MEMORY_TORQUE, MEMORY_SIZE,
) = range(12, 23)  # fmt: skip


@kernel
def are_models(models: FloatArray) -> bool:
    """Return whether rows (n, MODEL_COLUMNS) are valid models: finite, grasp stiffness not negative, contact 0 or 1."""
    for row in range(models.shape[0]):
        contact = models[row, MODEL_CONTACT]
        gains_energy = models[row, MODEL_GRASP_K] < 0.0 or models[row, MODEL_GRASP_B] < 0.0
        if gains_energy or not (contact == 0.0 or contact == 1.0):
            return False
    return True
