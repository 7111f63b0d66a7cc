r"""Kinematics and dynamics of a Phantom Premium 1.5.

Model and constants: Cavusoglu, Feygin and Tendick, "A Critical Study of the Mechanical and Electrical Properties of
the PHANToM Haptic Interface and Improvements for High Performance Control", Presence 11(6), 2002; transmission,
friction and limits as identified by the MAHI laboratory on the same arm. Angles are turret, thigh and shin, the last
measured from the vertical, not from the thigh. x points away from the base, z up.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

# By Cavusoglu et al. (2002); transmission and friction by the MAHI laboratory:
L1, L2, L3, L5, L6 = 0.215, 0.170, 0.0325, -0.0368, 0.0527  # m
MASS_A, MASS_C, MASS_BE, MASS_DF = 0.0202, 0.0249, 0.2359, 0.1906  # kg
IA_XX, IA_YY, IA_ZZ = 0.4864e-4, 0.001843e-4, 0.4864e-4  # kg m2
IC_XX, IC_YY, IC_ZZ = 0.959e-4, 0.959e-4, 0.0051e-4
IBE_XX, IBE_YY, IBE_ZZ = 11.09e-4, 10.06e-4, 0.591e-4
IDF_XX, IDF_YY, IDF_ZZ = 7.11e-4, 0.629e-4, 6.246e-4
I_BASE_YY = 11.87e-4
GRAVITY = 9.80665
GEARS = (13.3, 11.2, 11.2)
ROTOR_INERTIA = 1.08e-6  # kg m2
VISCOUS, COULOMB = 5e-4, 0.01  # N m s/rad, N m

#: Sweeps of dry friction over the joints; thigh and shin are coupled by at most a tenth of their masses.
_RUBS = 4
#: Stops, N m/rad and N m s/rad: the largest torque of a motor at the joint, 1.7 N m, goes into them by 10 degrees.
STOP_STIFFNESS, STOP_DAMPING = 10.0, 0.1
ANGLE_MIN = (math.radians(-90.0), math.radians(-124.0), math.radians(-29.0))
ANGLE_MAX = (math.radians(90.0), math.radians(119.0), math.radians(214.0))
THIGH_OVER_SHIN, SHIN_OVER_THIGH = math.radians(65.0), math.radians(55.0)

#: Count and friction for the servo's law, as in the device file.
COUNT_M, FRICTION_N = 30e-6, 0.04  # m, N, at the tip

#: Posture at the middle of the workspace: thigh and shin at a right angle, as their angles are equal, halfway up.
CENTRE_ANGLES = (0.0, 0.4, 0.4)

# M11 = _A + _B cos 2 theta2 + _C cos 2 theta3 + _D cos theta2 sin theta3;  M23 = -_D/2 sin(theta2 - theta3)
# Sums of these constants for the equations of motion, by Cavusoglu et al. (2002):
_A = 0.5 * (IA_YY + IA_ZZ + 2 * I_BASE_YY + IBE_YY + IBE_ZZ + IC_YY + IC_ZZ + IDF_YY + IDF_ZZ) + 0.125 * (
    4 * L1**2 * MASS_A + L2**2 * MASS_A + L1**2 * MASS_C + 4 * L3**2 * MASS_C
)
_B = 0.125 * (4 * IBE_YY - 4 * IBE_ZZ + 4 * IC_YY - 4 * IC_ZZ + L1**2 * (4 * MASS_A + MASS_C))
_C = 0.125 * (4 * IA_YY - 4 * IA_ZZ + 4 * IDF_YY - 4 * IDF_ZZ - L2**2 * MASS_A - 4 * L3**2 * MASS_C)
_D = L1 * (L2 * MASS_A + L3 * MASS_C)
_M22 = IBE_XX + IC_XX + L1**2 * MASS_A + 0.25 * L1**2 * MASS_C
_M33 = IA_XX + IDF_XX + 0.25 * L2**2 * MASS_A + L3**2 * MASS_C
_G2 = 0.5 * GRAVITY * (2 * L1 * MASS_A + 2 * L5 * MASS_BE + L1 * MASS_C)
_G3 = 0.5 * GRAVITY * (L2 * MASS_A + 2 * L3 * MASS_C - 2 * L6 * MASS_DF)


@kernel
def forward(angles: FloatArray | tuple[float, float, float], out: FloatArray) -> None:
    """Write the end point in the frame of the base into `out` (3,), in m."""
    reach = L1 * math.cos(angles[1]) + L2 * math.sin(angles[2])
    out[0] = math.cos(angles[0]) * reach
    out[1] = math.sin(angles[0]) * reach
    out[2] = L1 * math.sin(angles[1]) - L2 * math.cos(angles[2])


@kernel
def jacobian(angles: FloatArray, out: FloatArray) -> None:
    """Write d(end point)/d(angles) into `out` (3, 3)."""
    s1, c1 = math.sin(angles[0]), math.cos(angles[0])
    s2, c2 = math.sin(angles[1]), math.cos(angles[1])
    s3, c3 = math.sin(angles[2]), math.cos(angles[2])
    reach = L1 * c2 + L2 * s3
    out[0, 0], out[0, 1], out[0, 2] = -s1 * reach, -L1 * c1 * s2, L2 * c1 * c3
    out[1, 0], out[1, 1], out[1, 2] = c1 * reach, -L1 * s1 * s2, L2 * s1 * c3
    out[2, 0], out[2, 1], out[2, 2] = 0.0, L1 * c2, L2 * s3


def inverse(position: FloatArray) -> FloatArray:
    """Return the angles (3,) that put the end point at `position`, elbow up.

    Raises ValueError if the arm does not reach that far.
    """
    out = math.hypot(position[0], position[1])
    far2 = out**2 + position[2] ** 2
    lift = (L1**2 + far2 - L2**2) / (2.0 * L1 * math.sqrt(far2))
    elbow = (L1**2 + L2**2 - far2) / (2.0 * L1 * L2)
    if abs(lift) > 1.0 or abs(elbow) > 1.0:
        raise ValueError(f"the arm does not reach {math.sqrt(far2) * 1e3:.0f} mm from its base")
    thigh = math.acos(lift) + math.atan2(position[2], out)
    return np.array([math.atan2(position[1], position[0]), thigh, math.acos(elbow) + thigh - 0.5 * math.pi])


def centre() -> FloatArray:
    """Return the middle of the workspace in the frame of the base, (3,) in m."""
    out = np.zeros(3)
    forward(np.array(CENTRE_ANGLES), out)
    return out


@kernel
def mass(angles: FloatArray) -> tuple[float, float, float, float]:
    """Return M11, M22, M23 and M33 with the reflected rotors; the rest of the mass matrix is zero. In kg m2."""
    m11 = _A + _B * math.cos(2 * angles[1]) + _C * math.cos(2 * angles[2])
    m11 += _D * math.cos(angles[1]) * math.sin(angles[2]) + ROTOR_INERTIA * GEARS[0] ** 2
    m23 = -0.5 * _D * math.sin(angles[1] - angles[2])
    return m11, _M22 + ROTOR_INERTIA * GEARS[1] ** 2, m23, _M33 + ROTOR_INERTIA * GEARS[2] ** 2


@kernel
def accelerate(angles: FloatArray, rates: FloatArray, torque: FloatArray, out: FloatArray) -> None:
    """Write angular accelerations under joint torques `torque` into `out` (3,), friction left out.

    Coriolis terms are the Christoffel symbols of `mass`, so that without friction the energy is conserved.
    """
    s2, c2, s3, c3 = math.sin(angles[1]), math.cos(angles[1]), math.sin(angles[2]), math.cos(angles[2])
    m11, m22, m23, m33 = mass(angles)
    m11_by_2 = -2.0 * _B * math.sin(2 * angles[1]) - _D * s2 * s3
    m11_by_3 = -2.0 * _C * math.sin(2 * angles[2]) + _D * c2 * c3
    m23_by_2 = -0.5 * _D * math.cos(angles[1] - angles[2])
    w1, w2, w3 = rates[0], rates[1], rates[2]
    t1 = torque[0] - (m11_by_2 * w2 + m11_by_3 * w3) * w1
    t2 = torque[1] + 0.5 * m11_by_2 * w1 * w1 + m23_by_2 * w3 * w3 - _G2 * c2
    t3 = torque[2] + 0.5 * m11_by_3 * w1 * w1 - m23_by_2 * w2 * w2 - _G3 * s3
    determinant = m22 * m33 - m23 * m23
    out[0] = t1 / m11
    out[1] = (m33 * t2 - m23 * t3) / determinant
    out[2] = (m22 * t3 - m23 * t2) / determinant


@kernel
def passive_torque(angles: FloatArray, rates: FloatArray, joint: int) -> float:
    """Return viscous friction and hard stops of a joint in N m, which never add energy; dry friction is `rub`."""
    low, high = ANGLE_MIN[joint], ANGLE_MAX[joint]
    if joint == 1:
        low, high = max(low, angles[2] - SHIN_OVER_THIGH), min(high, angles[2] + THIGH_OVER_SHIN)
    elif joint == 2:
        low, high = max(low, angles[1] - THIGH_OVER_SHIN), min(high, angles[1] + SHIN_OVER_THIGH)
    torque = -VISCOUS * rates[joint]
    if angles[joint] < low:
        torque += STOP_STIFFNESS * (low - angles[joint]) - STOP_DAMPING * rates[joint]
    elif angles[joint] > high:
        torque += STOP_STIFFNESS * (high - angles[joint]) - STOP_DAMPING * rates[joint]
    return float(torque)


@kernel
def rub(angles: FloatArray, rates: FloatArray, dt: float, share: float = 1.0) -> None:
    """Apply a `share` of the dry friction of `dt` to rates (3,): an impulse at each joint of at most COULOMB dt.

    Modelled as a steep torque through rest, it would let an arm creep under a constant force, and its encoders toggle.
    """
    m11, m22, m23, m33 = mass(angles)
    most, determinant = share * COULOMB * dt, m22 * m33 - m23 * m23
    rates[0] -= min(max(m11 * rates[0], -most), most) / m11
    w2, w3, pull2, pull3 = rates[1], rates[2], 0.0, 0.0
    for _ in range(_RUBS):
        w2 = rates[1] + (m33 * pull2 - m23 * pull3) / determinant
        pull2 = min(max(pull2 - w2 * determinant / m33, -most), most)
        w3 = rates[2] + (m22 * pull3 - m23 * pull2) / determinant
        pull3 = min(max(pull3 - w3 * determinant / m22, -most), most)
    w2 = rates[1] + (m33 * pull2 - m23 * pull3) / determinant
    w3 = rates[2] + (m22 * pull3 - m23 * pull2) / determinant
    rates[1] = w2 if abs(pull2) == most else 0.0
    rates[2] = w3 if abs(pull3) == most else 0.0
