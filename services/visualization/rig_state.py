"""What the page says about the rig over the picture."""

from __future__ import annotations

import json

import protocol.bodies as bodies
from services.runtime.bus import Bus

_TOPIC = "supervisor.state"


class RigNotice:
    """Follows the supervisor; a rig without one, or with a silent one, says so."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._newest: bodies.SupervisorState | None = None

    def notice(self) -> str:
        """Return the text message of the view protocol that says what state the rig is in."""
        for frame in self._bus.drain(_TOPIC):
            self._newest = frame.body
        state = self._newest
        if state is None or not self._bus.is_fresh(_TOPIC):
            return _message("unknown", "no word from the supervisor", False)
        return _message(state.state, state.reason, state.safe_stop)

    def token_sha256(self) -> str:
        """Return the hash of the session's token, empty while no supervisor tells it."""
        state = self._newest
        return "" if state is None or not self._bus.is_fresh(_TOPIC) else state.token_sha256


def _message(state: str, reason: str, safe_stop: bool) -> str:
    return json.dumps({"type": "rig", "state": state, "reason": reason, "safe_stop": safe_stop})
