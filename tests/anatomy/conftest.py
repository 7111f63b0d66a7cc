"""The command in this process, as in tests/cli."""

from tests.cli.conftest import trocar

__all__ = ["trocar"]
