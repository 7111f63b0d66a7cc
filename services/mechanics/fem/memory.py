"""Memory that a model takes and memory that is free, checked before anything is allocated."""

from __future__ import annotations

import math
import os
import resource
from pathlib import Path

FACTOR_BYTES = 2_700
"""Stiffness and factors of tubes of 3,500 to 31,000 vertices, over n log2 n; measured, to 10 %."""


def solve_bytes(n_vertices: int) -> float:
    """Bytes that assembling and factorising a surface of so many vertices takes, about."""
    return FACTOR_BYTES * n_vertices * math.log2(max(n_vertices, 2))


def free_bytes() -> float:
    """Bytes that this process can still get: of the machine's memory, and of its own limit where it has one."""
    free = float(os.sysconf("SC_AVPHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    meminfo = Path("/proc/meminfo")
    if meminfo.exists():
        available = [line for line in meminfo.read_text().splitlines() if line.startswith("MemAvailable:")]
        free = 1024.0 * float(available[0].split()[1]) if available else free
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        free = min(free, float(limit - pages * os.sysconf("SC_PAGE_SIZE")))
    return free


def check_memory(n_vertices: int) -> None:
    """Refuse a mesh whose factors would not fit.

    Raises ValueError that names the number of vertices, the memory they take and what is free.
    """
    wanted, free = solve_bytes(n_vertices), free_bytes()
    if wanted > free:
        raise ValueError(
            f"mesh: {n_vertices} vertices take about {1e-9 * wanted:.2g} GB to solve, {1e-9 * free:.2g} GB are free: "
            "use larger triangles"
        )
