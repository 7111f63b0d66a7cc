"""Waiting for what another thread does."""

from __future__ import annotations

from tests.runtime.conftest import eventually

__all__ = ["eventually"]
