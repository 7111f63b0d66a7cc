from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.supervisor.made_up import Bench
from trocar.services.supervisor.page.command_socket import CommandSocket


@pytest.fixture
def control(bench: Bench) -> Iterator[CommandSocket]:
    with closing(CommandSocket(bench.supervisor)) as opened:
        yield opened
