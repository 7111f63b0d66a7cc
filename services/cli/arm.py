"""``trocar arm`` and ``trocar safe-stop``: commands to the supervisor, with the token that only this user can read."""

from __future__ import annotations

import json
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from services.runtime import config
from services.runtime.errors import BusError, UserError
from services.runtime.private_directory import open_text
from services.runtime.rig import Rig
from services.runtime.stop_line import stop_gateway
from services.supervisor.commands import What
from services.supervisor.control import ask, control_path
from services.supervisor.page_place import page_file

_PATIENCE_S = 3.0


@dataclass(frozen=True, slots=True)
class Access:
    """Where the supervisor's page is, and the token that it wants."""

    address: str
    token: str


def run_command(
    command: str,
    rig_name: str,
    overrides: tuple[str, ...] = (),
    access: Access | None = None,
    asked: Mapping[str, object] | None = None,
) -> dict[str, Any]:
    """Send ``arm``, ``safe_stop`` or an order of the ``attempt`` to the rig's supervisor; return what it answers.

    Raises
    ------
    UserError
        if there is no supervisor, or it refuses.
    """
    if access is None and command in ("arm", "safe_stop"):
        what: What = "arm" if command == "arm" else "safe_stop"
        return {"text": _ask_directly(config.load_rig(rig_name, overrides), what)}
    access = access or find_access(config.load_rig(rig_name, overrides))
    url, began_s = f"{access.address.rstrip('/')}/api", time.monotonic()
    try:
        with urllib.request.urlopen(f"{url}/state", timeout=_PATIENCE_S) as answer:
            state = json.load(answer)
        left_s = _PATIENCE_S - (time.monotonic() - began_s)  # nobody waits longer: it is not carried out after that
        before = f"{state['incarnation']} {max(state['t'] + left_s, 0.0):.3f}"
        data = None if asked is None else json.dumps(asked).encode()
        headers = {"X-Trocar-Token": access.token, "X-Trocar-Before": before}
        request = urllib.request.Request(f"{url}/{command}", data, method="POST", headers=headers)
        with urllib.request.urlopen(request, timeout=max(left_s, 0.001)) as answer:
            said: dict[str, Any] = json.load(answer)
            return said
    except urllib.error.HTTPError as error:
        with error:
            raise UserError(f"the supervisor at {access.address} answers: {_why(error.read())}") from None
    except (urllib.error.URLError, OSError, ValueError, KeyError) as error:
        reason = getattr(error, "reason", error)
        raise BusError(f"no supervisor answers at {access.address}: {reason}") from None


def _ask_directly(rig: Rig, what: What) -> str:
    """Return what came of a command to the supervisor on this host, or of a safe stop to the gateway in its place."""
    try:
        answer = ask(rig.transport, what, "the command line", _PATIENCE_S)
        why = "the supervisor does not answer" if answer is None else answer.text
    except OSError:
        answer, why = None, f"no supervisor is running here ({control_path(rig.transport)}); name one with --address"
    if answer is not None and answer.ok:
        return answer.text
    if what == "safe_stop" and stop_gateway(rig.transport):
        return f"{why}: the gateway itself has let every hand go"
    raise BusError(why) if answer is None else UserError(why)


def find_access(rig: Rig) -> Access:
    """Return how the supervisor of `rig` on this host is reached.

    Raises
    ------
    BusError
        if none has left its page file.
    """
    path = page_file(rig.transport)
    try:
        with open_text(path) as file:
            data = json.load(file)
        return Access(data["address"], data["token"])
    except FileNotFoundError:
        raise BusError(f"no supervisor is running here ({path} is not there); name one with --address") from None
    except (OSError, ValueError, KeyError):
        raise BusError(f"{path}: cannot be read as the supervisor's page file; name the page with --address") from None


def _why(body: bytes) -> str:
    try:
        return str(json.loads(body)["error"])
    except (ValueError, KeyError):
        return body[:200].decode("utf-8", "replace")
