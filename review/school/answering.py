"""Decodes what a page asks of the school, and answers; a sentence tells a person what can be mended."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Scope

from trocar.services.runtime.errors import UserError

#: Set by the page's server: who asks.
ROLE = "x-trocar-role"
_WORDS_BYTES = 1 << 18  # far more than any form or file of settings has, as it may be endless
Handler = Callable[[Request], Awaitable[Response]]


class PageQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for; each request takes what it needs of it."""

    trainee: str = ""
    pin: str = ""
    course: str = ""
    scale: str = ""
    points: dict[str, int] = {}
    at_s: float = 0.0
    words: str = ""
    by: str = "instructor"
    kind: str = ""
    value: str | bool = ""
    recordings: bool = False
    name: str = ""
    text: str = ""
    mark: str = ""
    key: str = ""


def answering(call: Callable[[Request, PageQuery], Any], *, desk: bool = False) -> Handler:
    """Return a handler that answers with what a call returns, or says why not; `desk`: to an instructor only."""

    async def handle(request: Request) -> Response:
        if desk and request.headers.get(ROLE) != "instructor":
            return as_json({"error": "the token of the class is needed: only an instructor may do this"}, 403)
        try:
            text = await body_of(request, _WORDS_BYTES)
            ask = msgspec.json.decode(text, type=PageQuery) if text else PageQuery()
            found = await run_in_threadpool(call, request, ask)
        except msgspec.DecodeError as error:
            return as_json({"error": f"the request cannot be read: {error}"}, 400)
        except UserError as error:
            return as_json({"error": str(error)}, 409)
        return found if isinstance(found, Response) else as_json(found)

    return handle


def as_instructor(scope: Scope) -> Scope:
    """Return a request with the role of an instructor, whatever role it names itself."""
    headers = [each for each in scope.get("headers", []) if each[0] != ROLE.encode()]
    return {**scope, "headers": [*headers, (ROLE.encode(), b"instructor")]}


def as_json(value: object, status: int = 200) -> Response:
    """Return a value as JSON."""
    return Response(msgspec.json.encode(value), status, media_type="application/json")


async def body_of(request: Request, most: int) -> bytes:
    """Return the body of a request. Raises UserError if it has more than `most` bytes."""
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > most:
            raise UserError(f"more than {most} bytes are not taken")
    return bytes(data)
