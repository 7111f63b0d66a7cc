"""The way to the school's process: whatever a page asks for stays one request, with the role that its token gives."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from tests.patience import PATIENCE_S
from trocar.services.supervisor.page.school import pass_on

Answer = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


async def _answered(
    tmp_path: Path, answer: Answer, path: str = "own", body: bytes | AsyncIterator[bytes] | None = None
) -> tuple[int, bytes]:
    """Return status and body of what a trainee is told where the school answers like this."""

    async def handle(request: Request) -> Response:
        return await pass_on(request, tmp_path / "sock", "trainee")

    app = Starlette(routes=[Route("/school/{path:path}", handle, methods=["GET", "POST"])])
    async with (
        await asyncio.start_unix_server(answer, str(tmp_path / "sock")),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://rig") as client,
    ):
        said = await client.request("GET" if body is None else "POST", f"/school/{path}", content=body)
    return said.status_code, said.content


async def _arrived(tmp_path: Path, path: str, body: bytes | AsyncIterator[bytes] | None) -> tuple[int, list[bytes]]:
    """Return the status of a trainee's request, and what reached the school's socket."""
    seen: list[bytes] = []

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        seen.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\n\r\n{}")
        writer.close()

    return (await _answered(tmp_path, answer, path, body))[0], seen


@pytest.mark.parametrize("end", ["%0d", "%0d%0a"])
def test_no_path_ends_the_line_that_it_is_in(tmp_path: Path, end: str) -> None:
    path = f"x%20HTTP/1.1{end}x-trocar-role:%20instructor{end}{end}"
    status, heads = asyncio.run(_arrived(tmp_path, path, None))
    assert (status, len(heads)) in ((200, 1), (404, 0))
    for head in heads:
        assert len(head.split(b"\r\n")[0].split()) == 3
        assert b"\r" not in head.replace(b"\r\n", b"")


@pytest.mark.parametrize("body", [b"", b"{}"])
def test_a_body_of_known_length_is_passed_on(tmp_path: Path, body: bytes) -> None:
    status, (head,) = asyncio.run(_arrived(tmp_path, "enter", body))
    assert (status, f"content-length: {len(body)}".encode() in head) == (200, True)


def test_a_body_of_unknown_length_is_refused(tmp_path: Path) -> None:
    async def parts() -> tuple[int, list[bytes]]:
        async def body() -> AsyncIterator[bytes]:
            yield b"POST /erase HTTP/1.1\r\nx-trocar-role: instructor\r\n\r\n"

        return await _arrived(tmp_path, "enter", body())

    assert asyncio.run(parts()) == (411, [])


def test_an_answer_in_chunks_is_passed_on_without_their_lengths(tmp_path: Path) -> None:
    """So answers a server that does not know the length beforehand, as of what it makes while it sends."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n5\r\nfirst\r\n6\r\nsecond\r\n0\r\n\r\n")
        writer.close()

    assert asyncio.run(_answered(tmp_path, answer)) == (200, b"firstsecond")


@pytest.mark.parametrize(
    "said", [b"", b"no HTTP at all\r\n\r\n", b"HTTP/1.1 200 OK\r\n", b"HTTP/1.1 200 OK\r\nx: " + b"y" * (1 << 17)]
)
def test_what_is_no_answer_is_told_as_none(tmp_path: Path, said: bytes) -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(said)
        writer.close()

    assert asyncio.run(_answered(tmp_path, answer)) == (504, b'{"error":"the school has not answered"}')


def test_who_goes_before_the_answer_leaves_no_connection_to_the_school(tmp_path: Path) -> None:
    ended = asyncio.Event()

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 200 OK\r\n\r\n{")
        await reader.read()
        ended.set()
        writer.close()

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def gone(_: Any) -> None:
        raise ConnectionResetError

    async def request() -> Response:
        scope = {"type": "http", "asgi": {"spec_version": "2.4"}, "method": "GET", "path": "/own", "query_string": b"",
                 "headers": [], "path_params": {"path": "own"}}  # fmt: skip
        async with await asyncio.start_unix_server(answer, str(tmp_path / "sock")):
            response = await pass_on(Request(scope, receive), tmp_path / "sock", "trainee")
            with pytest.raises(ClientDisconnect):
                await response(scope, receive, gone)
            await asyncio.wait_for(ended.wait(), PATIENCE_S)
        return response

    asyncio.run(request())
