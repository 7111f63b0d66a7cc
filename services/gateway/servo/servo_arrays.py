"""Columns of the servo's flat float64 arrays, which pass into a kernel without being unpacked."""

from __future__ import annotations

from trocar.protocol.bodies.haptics import MODEL_CONTACT, MODEL_GRASP_B, MODEL_GRASP_K
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

# Readings of an arm in its own frame: z up, origin at the middle of its workspace.
READ_POSITION, READ_VELOCITY, READ_TEMPERATURE, READ_ROLL, READ_SIZE = 0, 3, 6, 7, 8

# Readings of a handle.
HANDLE_ANGLE, HANDLE_RATE, HANDLE_SIZE = 0, 1, 2

# Limits of an arm and its handle. What `energy_bound` has to know of either begins at the places below: its encoder's
# count, m or rad; the least friction that it surely has, N or N m; and the least change of a displacement from tick to
# tick that any hand may make of it, m or rad.
(
    LIMIT_FORCE, LIMIT_CONTINUOUS_FORCE, LIMIT_RATE, LIMIT_TORQUE, LIMIT_TORQUE_RATE, LIMIT_ARM,
) = range(6)  # fmt: skip
OWN_COUNT, OWN_FRICTION, OWN_SUDDEN, OWN_SIZE = range(4)
LIMIT_HANDLE = LIMIT_ARM + OWN_SIZE
LIMIT_SIZE = LIMIT_HANDLE + OWN_SIZE

# The present tick: time since the last, age of the model and of its end, engagement of arm and handle, temperature; of
# the hands of all others the energy that they have put in, and what they may get back in this tick; the longest time
# from a motion to the force that answers it, s, for the last force and for this one; and how many forces in a row, up
# to the last, were not sent, as the one before them had not been answered.
(
    NOW_DT, NOW_AGE, NOW_TTL, NOW_GAIN, NOW_GRASP_GAIN, NOW_TEMPERATURE, NOW_OTHERS, NOW_RESERVED, NOW_LAST_LATE_S,
    NOW_LATE_S, NOW_SKIPPED, NOW_SIZE,
) = range(12)  # fmt: skip

# Forces that may not have reached the motors yet: of each the one before it, and for how long that may still act. As
# many as there are ticks until a force model itself is too old to be held (`servo_law.HOLD_S`).
FLIGHTS, FLIGHT_SIZE, FLIGHT_LEFT = 5, 4, 3

# State of the servo between ticks: first the books of the arm, which `energy_bound` defines, then what is the law's
# own. At MEMORY_TORQUE begin the books of the handle, with the same places: a torque is a force on one axis.
MEMORY_FORCE, MEMORY_POSITION, MEMORY_WAY, MEMORY_ANCHOR, MEMORY_FLIGHTS = 0, 3, 6, 9, 12
(
    MEMORY_ENERGY, MEMORY_BY_STEPS, MEMORY_AT_ANCHOR, MEMORY_RESERVED, MEMORY_RETURNED, MEMORY_SUDDEN, MEMORY_UNKNOWN,
    MEMORY_SKIPPED, BOOKS_SIZE,
) = range(MEMORY_FLIGHTS + FLIGHTS * FLIGHT_SIZE, MEMORY_FLIGHTS + FLIGHTS * FLIGHT_SIZE + 9)  # fmt: skip
(
    MEMORY_HOT, MEMORY_DEMAND, MEMORY_REFUSED, MEMORY_SCALE, MEMORY_STIFFNESS, MEMORY_TORQUE,
) = range(BOOKS_SIZE, BOOKS_SIZE + 6)  # fmt: skip
MEMORY_SIZE = MEMORY_TORQUE + BOOKS_SIZE


@kernel
def are_models(models: FloatArray) -> bool:
    """Return whether rows (n, MODEL_COLUMNS) are valid models: finite, grasp stiffness not negative, contact 0 or 1."""
    for row in range(models.shape[0]):
        contact = models[row, MODEL_CONTACT]
        gains_energy = models[row, MODEL_GRASP_K] < 0.0 or models[row, MODEL_GRASP_B] < 0.0
        if gains_energy or not (contact == 0.0 or contact == 1.0):
            return False
    return True
