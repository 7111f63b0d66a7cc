"""``trocar arm`` and ``trocar safe-stop``: commands to the supervisor of this host, or to one at an address."""

from __future__ import annotations

import json
import ssl
import time
import urllib.error
import urllib.request
from typing import Any, NamedTuple

from trocar.protocol.topics import HEARTBEAT_S
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import BusError, UserError
from trocar.services.runtime.web.web_client import open_url
from trocar.services.supervisor.control.commands import Command, What
from trocar.services.supervisor.page.command_socket import ANSWER_S, ask_rig
from trocar.services.supervisor.page.page_place import page_file, read_page_file

#: Longer by a heartbeat than the supervisor of this host may take, as a page elsewhere is reached over a network.
PATIENCE_S = ANSWER_S + HEARTBEAT_S
WHO = "the command line"


class RigPage(NamedTuple):
    """Address of a rig's page, and the fingerprint of its certificate; empty without one."""

    address: str
    fingerprint: str = ""


def run_command(
    what: What,
    rig_name: str,
    overrides: tuple[str, ...],
    address: str | None,
    token: str | None,
    fingerprint: str | None = None,
) -> None:
    """Send ``arm`` or ``safe_stop`` to the rig's supervisor; print what came of it.

    Raises UserError if there is no supervisor, or it refuses.
    """
    if address is not None:
        print(ask_at(RigPage(address, fingerprint or ""), token or "", what))
        return
    print_answer(config.load_rig(rig_name, overrides), Command(what=what, who=WHO))


def print_answer(rig: Rig, command: Command) -> None:
    """Send a command to the rig on this host and print what came of it; raises as `run_command` does."""
    answer = ask_rig(rig.transport, command, PATIENCE_S)
    if not answer.ok:
        raise UserError(answer.text)
    print(answer.text)


def ask_at(page: RigPage, token: str, what: str, asked: object = None) -> str:
    """Return what a supervisor answers at its page to a request with the body `asked`; raises as `run_command` does."""
    url, began_s = f"{page.address.rstrip('/')}/api", time.monotonic()
    state = state_at(page)
    left_s = PATIENCE_S - (time.monotonic() - began_s)  # nobody waits longer: it is not carried out after that
    try:
        before = f"{state['incarnation']} {max(state['t'] + left_s, 0.0):.3f}"
        data = None if asked is None else json.dumps(asked).encode()
        headers = {"X-Trocar-Token": token, "X-Trocar-Before": before}
        request = urllib.request.Request(f"{url}/{what}", data, method="POST", headers=headers)
        with open_url(request, max(left_s, 0.001), page.fingerprint) as answer:
            return str(json.load(answer)["text"])
    except urllib.error.HTTPError as error:
        with error:
            raise UserError(f"the supervisor at {page.address} answers: {_why(error.read())}") from None
    except TimeoutError:
        raise BusError(
            f"the supervisor at {page.address} has not answered in time: its page tells whether this was done"
        ) from None
    except (OSError, ValueError, KeyError) as error:
        raise _silent(page, error) from None


def state_at(page: RigPage) -> dict[str, Any]:
    """Return the state of a rig as its page has it. Raises BusError if nobody answers there."""
    try:
        request = urllib.request.Request(f"{page.address.rstrip('/')}/api/state")
        with open_url(request, PATIENCE_S, page.fingerprint) as answer:
            state: dict[str, Any] = json.load(answer)
            return state
    except (OSError, ValueError) as error:
        raise _silent(page, error) from None


def page_of(rig: Rig) -> RigPage:
    """Return where the page is of `rig` on this host. Raises BusError if no supervisor has left its page file."""
    path = page_file(rig.transport)
    try:
        content = read_page_file(path)
        return RigPage(content.address, content.fingerprint)
    except FileNotFoundError:
        raise BusError(f"no supervisor is running here ({path} is not there)") from None
    except (OSError, ValueError, KeyError):
        raise BusError(f"{path}: cannot be read as the supervisor's page file") from None


def _silent(page: RigPage, error: Exception) -> BusError:
    why = getattr(error, "reason", error)
    if isinstance(why, ssl.SSLCertVerificationError):
        why = "nobody vouches for its certificate; name with --fingerprint the one that the rig printed"
    return BusError(f"no supervisor answers at {page.address}: {why}")


def _why(body: bytes) -> str:
    try:
        return str(json.loads(body)["error"])
    except (ValueError, KeyError):
        return body[:200].decode("utf-8", "replace")
