"""Commands without a page, and a safe stop where the supervisor stands still."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from tests.gateway.orders.test_supervisor_commands import Stub, _frame
from tests.review.class_of_pages import page
from tests.supervisor.made_up import Bench, rig
from trocar.services.cli.app import app
from trocar.services.gateway.orders.supervisor_commands import SupervisorCommands
from trocar.services.gateway.servo.engagement import EngagementState
from trocar.services.runtime.bus.stop_line import StopLine, stop_gateway
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.command_socket import CommandSocket, ask_rig, control_path
from trocar.services.supervisor.page.web import PageContext, build_app


@pytest.fixture
def bench(private_folder: Path) -> Bench:
    made = Bench(rig(transport={"directory": private_folder}))
    made.run(5.0, lambda: made.supervisor.state is RigState.RUNNING)
    return made


def trocar(folder: Path, command: str, *turned: Any) -> tuple[int, str]:
    """Run a command while others take turns; return its exit code and what it says."""
    said: list[Any] = []
    line = [command, "--set", f"transport.directory={folder}"]
    asking = threading.Thread(target=lambda: said.append(CliRunner().invoke(app, line)))
    asking.start()
    while asking.is_alive():
        for turn in turned:
            turn()
        time.sleep(0.001)
    result = said[0]
    return result.exit_code, f"{result.output}{result.exception or ''}"


def turn_of(bench: Bench, control: CommandSocket, obeys: bool = True) -> Any:
    def turn() -> None:
        bench.run(0.01)
        if obeys:
            bench.peers["gateway"].gauges["safe_stop"] = float(bench.supervisor.body().safe_stop)
        control.run_turn(bench.now_s)

    return turn


def test_commands_need_no_page(bench: Bench, control: CommandSocket, private_folder: Path) -> None:
    code, said = trocar(private_folder, "safe-stop", turn_of(bench, control))
    assert (code, said) == (0, "safe stop: every hand is let go\n")
    assert bench.supervisor.state is RigState.SAFE_STOP
    assert trocar(private_folder, "arm", turn_of(bench, control)) == (0, "armed: hands may be pushed\n")
    assert bench.supervisor.body().armed == 1


def test_a_safe_stop_that_nothing_came_of_is_no_success(
    bench: Bench, control: CommandSocket, private_folder: Path
) -> None:
    """It ended with 0 while the supervisor stood still."""
    code, said = trocar(private_folder, "safe-stop")
    assert (code != 0, "the supervisor does not answer" in said) == (True, True)
    code, said = trocar(private_folder, "safe-stop", turn_of(bench, control, obeys=False))
    assert (code != 0, "has not said that it obeys" in said) == (True, True)


def test_silent_callers_keep_no_command_out(bench: Bench, control: CommandSocket, private_folder: Path) -> None:
    """Eight connections that nobody spoke on did."""
    with ExitStack() as stack:
        for _ in range(20):
            caller = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            caller.connect(str(control_path(Transport(directory=private_folder))))
            control.run_turn(bench.now_s)
        assert trocar(private_folder, "arm", turn_of(bench, control)) == (0, "armed: hands may be pushed\n")


def test_where_the_supervisor_stands_still_the_gateway_itself_is_asked(
    bench: Bench, control: CommandSocket, private_folder: Path
) -> None:
    hand = Stub()
    orders = SupervisorCommands([hand], None)  # type: ignore[list-item]
    orders.line = StopLine(Transport(directory=private_folder))
    hand.engagement.state = EngagementState.ACTIVE
    code, said = trocar(private_folder, "safe-stop", lambda: orders.obey_frames([], 1))
    assert (code, said) == (0, "the supervisor does not answer: the gateway itself has let every hand go\n")
    assert (orders.stopped, orders.stop_report, hand.engagement.gain) == (True, 2.0, 0.0)
    orders.obey_frames([_frame(False, armed=1), _frame(False, armed=2)], 1)
    assert orders.stopped, "nobody has ended it"
    bench.peers["gateway"].gauges["safe_stop"] = orders.stop_report
    bench.run(0.3)
    assert bench.supervisor.reason == "asked of the gateway itself", "the supervisor that goes on makes it its own"
    orders.obey_frames([_frame(True), _frame(False)], 1)
    assert (orders.stop_report, hand.armed) == (0.0, 1)
    orders.line.close()


def test_the_page_has_the_same_way_to_the_gateway(bench: Bench, control: CommandSocket, private_folder: Path) -> None:
    orders = SupervisorCommands([Stub()], None)  # type: ignore[list-item]
    transport = bench.supervisor.rig.transport
    orders.line = StopLine(transport)
    context = page()
    context.ask = lambda command: ask_rig(transport, command, patience_s=0.3)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(
            _posted, context, "/api/safe_stop", {"X-Trocar-Before": f"{bench.supervisor.incarnation} 60"}
        )
        while not asked.done():
            orders.obey_frames([], 1)
            time.sleep(0.001)
    assert asked.result() == "the supervisor does not answer: the gateway itself has let every hand go"
    assert orders.stopped
    orders.line.close()


def test_no_incarnation_on_the_page_means_the_present_run(bench: Bench, control: CommandSocket) -> None:
    """`0` did, and armed the rig."""
    context, transport = page(), bench.supervisor.rig.transport
    context.ask = lambda command: ask_rig(transport, command)
    turn = turn_of(bench, control)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(_posted, context, "/api/arm", {"X-Trocar-Before": "0 60"}, "error")
        while not asked.done():
            turn()
            time.sleep(0.001)
    assert asked.result() == "it was meant for another run of the rig: nothing was done"
    assert bench.supervisor.body().armed == 0


def _posted(context: PageContext, path: str, headers: dict[str, str], field: str = "text") -> str:
    async def once() -> str:
        transport = httpx.ASGITransport(build_app(context))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost:8080") as client:
            answer = await client.post(path, headers={"X-Trocar-Token": context.token, **headers})
            return str(answer.json()[field])

    return asyncio.run(once())


def test_an_arm_is_not_undone_by_a_report_of_before_it(bench: Bench) -> None:
    gauges = bench.peers["gateway"].gauges
    gauges["safe_stop"] = 2.0
    bench.run(0.3)
    assert bench.supervisor.body().safe_stop
    bench.supervisor.arm("a test")
    bench.run(0.15)  # the report that is under way says what was
    gauges["safe_stop"] = 0.0
    bench.run(1.0)
    assert not bench.supervisor.body().safe_stop
    gauges["safe_stop"] = 2.0
    bench.run(0.3)
    assert bench.supervisor.body().safe_stop, "and one that comes after it holds"


def test_garbage_on_the_line_is_hung_up_on(bench: Bench, control: CommandSocket, private_folder: Path) -> None:
    callers = [socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(20)]
    for caller in callers:
        caller.settimeout(5.0)
        with_room = True
        try:
            caller.connect(str(control_path(Transport(directory=private_folder))))
            caller.send(b"\xff{" * 9)
        except OSError:
            with_room = False
        control.run_turn(bench.now_s)
        control.run_turn(bench.now_s)
        assert with_room
        caller.close()
    assert trocar(private_folder, "arm", turn_of(bench, control))[0] == 0


def test_nobody_is_asked_where_no_gateway_runs(private_folder: Path) -> None:
    assert not stop_gateway(Transport(directory=private_folder))
