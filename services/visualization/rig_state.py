"""The rig's state over the picture."""

from __future__ import annotations

import json

import trocar.protocol.bodies as bodies
from trocar.services.runtime.bus.bus import Bus

_TOPIC = "supervisor.state"


class RigNotice:
    """Follows the supervisor's state; reports a missing or silent supervisor."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._newest: bodies.SupervisorState | None = None

    def notice(self) -> str:
        """Return the view protocol's text message on the rig's state."""
        for frame in self._bus.drain(_TOPIC):
            self._newest = frame.body
        state = self._newest
        if state is None or not self._bus.is_fresh(_TOPIC):
            return _message("unknown", "no word from the supervisor", False)
        return _message(state.state, state.reason, state.safe_stop)

    def token_sha256(self) -> str:
        """Return the hash of the session's token, empty without a supervisor."""
        state = self._newest
        return "" if state is None or not self._bus.is_fresh(_TOPIC) else state.token_sha256


def _message(state: str, reason: str, safe_stop: bool) -> str:
    return json.dumps({"type": "rig", "state": state, "reason": reason, "safe_stop": safe_stop})
