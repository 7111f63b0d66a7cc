"""The first test of a fresh checkout compiles the kernels: 20 s of one core, minutes on a loaded machine."""

from pathlib import Path

import pytest

COMPILE_S = 600


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.timeout(COMPILE_S))
