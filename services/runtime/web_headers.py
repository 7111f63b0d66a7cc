"""Headers of served pages: nothing from elsewhere runs in them, nobody frames them, no type is guessed.

A page's own scripts and styles, written in it, are named by their hashes; so nothing else that finds its way into its
markup runs, and no page needs a second file.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64encode
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_STYLE = re.compile(r"<style>(.*?)</style>", re.DOTALL)
_Message = MutableMapping[str, Any]


def page_policy(html: str, *more: str) -> str:
    """Return the Content-Security-Policy of a page with its own scripts and styles in it, and nothing else.

    Args:
        html: The page. What a browser does not run (``<script type="application/json">``) needs no permission.
        more: Directives that it needs besides, as ``img-src blob:``.
    """
    said = ["default-src 'none'", *_hashes("script-src", _SCRIPT.findall(html))]
    said += [*_hashes("style-src", _STYLE.findall(html)), *more]
    return "; ".join([*said, "base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'"])


def _hashes(directive: str, parts: Iterable[str]) -> list[str]:
    named = " ".join(f"'sha256-{b64encode(hashlib.sha256(each.encode()).digest()).decode()}'" for each in parts)
    return [f"{directive} {named}"] if named else []


class SafeHeaders:
    """ASGI middleware that adds headers to every answer, also to refusals; what an answer says itself stays.

    Args:
        app: The wrapped application, called with scope, receive and send.
        policy: The Content-Security-Policy of all answers.
    """

    def __init__(self, app: Callable[..., Awaitable[None]], policy: str) -> None:
        self._app = app
        self._headers = {
            b"content-security-policy": policy.encode("latin-1"),
            b"x-content-type-options": b"nosniff",
            b"x-frame-options": b"DENY",
            b"referrer-policy": b"no-referrer",
            b"cross-origin-resource-policy": b"same-origin",
            b"cache-control": b"no-store",
        }

    async def __call__(self, scope: Any, receive: Any, send: Callable[[_Message], Awaitable[None]]) -> None:
        """Pass a request on, and add the headers to its answer."""

        async def with_headers(message: _Message) -> None:
            if message["type"] == "http.response.start":
                said = [(name.lower(), value) for name, value in message.get("headers", ())]
                names = {name for name, _ in said}
                message["headers"] = [*said, *((k, v) for k, v in self._headers.items() if k not in names)]
            await send(message)

        await self._app(scope, receive, with_headers)
