"""Headers of served pages: nothing from elsewhere runs in them, nobody frames them, no type is guessed.

A page consists of files of its own server, or of one text; scripts and styles written in a text are named by their
hashes, so nothing else that finds its way into its markup runs.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64encode
from collections.abc import Awaitable, Callable, Iterable, Mapping, MutableMapping
from typing import Any

_NEVER = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; object-src 'none'"
#: Content-Security-Policy of all that is no page: data, pictures, scripts and style sheets, also where opened alone.
NO_PAGE = f"default-src 'none'; {_NEVER}"
_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_STYLE = re.compile(r"<style>(.*?)</style>", re.DOTALL)
_Message = MutableMapping[str, Any]


def policy_of_files(connects_to: str = "") -> str:
    """Return the Content-Security-Policy of a page whose scripts and styles are files of its own server.

    `connects_to` are further sources for its connections, as the policy writes them.
    """
    connections = f"'self' {connects_to}".strip()
    return f"default-src 'self'; connect-src {connections}; img-src 'self' data:; {_NEVER}"


def policy_of_text(html: str, *more: str) -> str:
    """Return the Content-Security-Policy of a page with its own scripts and styles in it, and nothing else.

    Args:
        html: The page. What a browser does not run (``<script type="application/json">``) needs no permission.
        more: Directives that it needs besides, as ``img-src blob:``.
    """
    said = ["default-src 'none'", *_hashes("script-src", _SCRIPT.findall(html))]
    said += [*_hashes("style-src", _STYLE.findall(html)), *more]
    return "; ".join([*said, _NEVER])


def _hashes(directive: str, parts: Iterable[str]) -> list[str]:
    named = " ".join(f"'sha256-{b64encode(hashlib.sha256(each.encode()).digest()).decode()}'" for each in parts)
    return [f"{directive} {named}"] if named else []


class SafeHeaders:
    """ASGI middleware that adds headers to every answer, also to refusals; what an answer says itself stays.

    Args:
        app: The wrapped application, called with scope, receive and send.
        policy: The Content-Security-Policy of all answers that have none of their own.
        also: Further headers by name.
    """

    def __init__(
        self, app: Callable[..., Awaitable[None]], policy: str = NO_PAGE, also: Mapping[str, str] | None = None
    ) -> None:
        self._app = app
        headers = {"content-security-policy": policy, "x-content-type-options": "nosniff"}
        headers |= {"referrer-policy": "no-referrer", **(also or {})}
        self._headers = {name.encode("latin-1"): value.encode("latin-1") for name, value in headers.items()}

    async def __call__(self, scope: Any, receive: Any, send: Callable[[_Message], Awaitable[None]]) -> None:
        """Pass a request on, and add the headers to its answer."""

        async def send_with_headers(message: _Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                given = [(bytes(name).lower(), value) for name, value in message.get("headers", ())]
                names = {name for name, _ in given}
                headers = [*given, *((k, v) for k, v in self._headers.items() if k not in names)]
                message = {**message, "headers": headers}
            await send(message)

        await self._app(scope, receive, send_with_headers)
