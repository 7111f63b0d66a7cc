"""EngagementState machine that decides whether a hand may bear force, between a device and the force law.

Force begins, and returns, only with a fresh stream, a small demand, and a ramp. A stop by a person is never undone
automatically.
"""

from __future__ import annotations

from enum import StrEnum

#: A stream must have been fresh, and its demand small, for this long before force begins: five lives of a model. What
#: is small is a tenth of the 3 N to which a rig limits forces by default, so that a hand is not surprised by it.
SETTLE_S, SMALL_FORCE_N = 0.1, 0.3


class EngagementState(StrEnum):
    """States of one instrument."""

    OFF = "off"
    CALIBRATING = "calibrating"
    READY = "ready"
    ENGAGING = "engaging"
    ACTIVE = "active"
    STALE = "stale"
    FAULT = "fault"


class Engagement:
    """EngagementState and gain (0 limp to 1 full) of one instrument.

    Args:
        ramp_s: Time from the first force to full force.
    """

    def __init__(self, ramp_s: float) -> None:
        self.state = EngagementState.OFF
        self.gain = 0.0
        self.fault = ""
        self._ramp_s = ramp_s
        self._settled_s = 0.0
        self._stopped = False
        self.unsupervised = False  # no supervisor is heard that could stop it; set from outside
        self.rests = False  # no force, because the scene restarts or the rig's time is stopped
        self.refused_s = 0.0  # how long force has been prevented only by a large demand

    @property
    def engaged(self) -> bool:
        """Whether force is on or coming."""
        return self.state in (EngagementState.ENGAGING, EngagementState.ACTIVE)

    def open(self, calibrated: bool) -> None:
        """Leave OFF, as the device is open."""
        self._let_go(EngagementState.READY if calibrated else EngagementState.CALIBRATING)

    def fail(self, reason: str) -> None:
        """Remove the force until a person arms the rig; the first reason is kept."""
        if self.state is not EngagementState.FAULT:
            self._let_go(EngagementState.FAULT)
            self.fault = reason

    def let_go(self) -> None:
        """Remove the force until the stream is fresh again, after its loss or a restart of haptics."""
        if self.engaged:
            self._let_go(EngagementState.STALE)

    def stop(self) -> None:
        """Remove the force until `arm` (safe stop)."""
        self._stopped = True
        if self.engaged or self.state is EngagementState.STALE:
            self._let_go(EngagementState.READY)

    def arm(self) -> None:
        """Allow force again, by re-engagement, as a person has armed the rig."""
        self._stopped = False
        if self.state is EngagementState.FAULT:
            self.fault = ""
            self._let_go(EngagementState.READY)

    def step(self, dt_s: float, *, fresh: bool, alive: bool, demand_n: float, calibrated: bool) -> bool:
        """Advance by `dt_s`; return True in the tick in which force begins, so that motors can be switched on.

        Args:
            fresh: Whether the newest model is young enough to be used as it is.
            alive: Whether the newest model is younger than its ``ttl_s``.
            demand_n: Force of the model at the present pose.
            calibrated: Whether the device's position is valid.
        """
        if self.state is EngagementState.CALIBRATING and calibrated:
            self.state = EngagementState.READY
        if self.unsupervised or self.rests:
            fresh = alive = False
        if self.engaged and not alive:
            self._let_go(EngagementState.STALE)
        if self.state in (EngagementState.READY, EngagementState.STALE):
            may_begin = fresh and calibrated and not self._stopped
            self.refused_s = self.refused_s + dt_s if may_begin and demand_n >= SMALL_FORCE_N else 0.0
            return self._settle_stream(dt_s, may_begin and demand_n < SMALL_FORCE_N)
        if self.state is EngagementState.ENGAGING:
            self.gain = min(1.0, self.gain + dt_s / self._ramp_s) if self._ramp_s > 0.0 else 1.0
            if self.gain >= 1.0:
                self.state = EngagementState.ACTIVE
        return False

    def _settle_stream(self, dt_s: float, quiet: bool) -> bool:
        self._settled_s = self._settled_s + dt_s if quiet else 0.0
        if self._settled_s < SETTLE_S:
            return False
        self.state = EngagementState.ENGAGING
        return True

    def _let_go(self, state: EngagementState) -> None:
        self.state = state
        self.gain = 0.0
        self._settled_s = 0.0
        self.refused_s = 0.0
