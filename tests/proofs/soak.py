"""A rig that runs for an hour: its descriptors, its memory and its misses stay as they were once it had run in."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.proofs import flat
from tests.proofs.faults import PRESSES
from tests.proofs.trials import Found, Proof, Try
from tests.rig.conftest import SCENE, Rig, running_rig
from tests.rig.faults import engage

MINUTE_S, RUNS_IN_S = 60.0, 120.0
LOOPS = ("gateway", "haptics", "physics")


@contextmanager
def _begin() -> Iterator[Try]:
    topics = tuple(f"{name}.health" for name in LOOPS)
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), str(SCENE), [*PRESSES], topics) as rig:
        engage(rig)
        _look_for(rig, RUNS_IN_S)
        first, past = held(rig), list[dict[str, float]]()

        def try_once(_chance: np.random.Generator) -> Found:
            late = _look_for(rig, MINUTE_S)
            if gone := [name for name, pid in pids(rig).items() if pid != first[name][0]]:
                changed = f"{gone} changed: {rig.observer.states[-1][1].reason}"
                return Found(failed=1, why=(changed,))
            now = held(rig)
            why = [
                f"{name} holds {now[name][1]} descriptors, {first[name][1]} once it had run in"
                for name in first
                if now[name][1] > first[name][1]
            ]
            figures = {f"{name} MB": round(1e-6 * memory, 3) for name, (_, _, memory) in now.items()}
            figures |= {f"{name} descriptors": count for name, (_, count, _) in now.items()}
            past.append({**figures, **late})
            why += flat.judge(past)
            return Found(failed=int(bool(why)), why=tuple(why), figures=past[-1])

        yield try_once


def held(rig: Rig) -> dict[str, tuple[int, int, int]]:
    """Return by process its pid, how many descriptors it holds, and how much memory of its own, bytes."""
    found = pids(rig)
    return {name: (pid, len(list(Path(f"/proc/{pid}/fd").iterdir())), _own_bytes(pid)) for name, pid in found.items()}


def pids(rig: Rig) -> dict[str, int]:
    """Return the process of each name, 0 for none."""
    return {**rig.observer.pids(), "supervisor": rig.process.pid}


def _own_bytes(pid: int) -> int:
    rows = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    return sum(1024 * int(rows[name].split()[0]) for name in ("RssAnon", "RssShmem", "VmSwap"))


def _look_for(rig: Rig, seconds: float) -> dict[str, float]:
    """Watch, and return by loop how many ticks of a thousand missed their deadline."""
    counts: dict[str, list[tuple[int, int]]] = {name: [] for name in LOOPS}
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        time.sleep(0.02)
        rig.observer.look()
        rig.observer.samples.clear()
        del rig.observer.states[:-1]
        for name, seen in counts.items():
            frames = rig.observer.bus.drain(f"{name}.health")
            seen += [(each.body.loop.ticks, each.body.loop.misses) for each in frames if each.body.loop is not None]
    return {
        f"{name} misses": round(1e3 * (seen[-1][1] - seen[0][1]) / max(1, seen[-1][0] - seen[0][0]), 3)
        for name, seen in counts.items()
    }


PROOF = Proof(
    "soak", "minutes of one rig", flat.MINUTES, "descriptors, memory and misses stay flat",
    _begin, at_once=True,
)  # fmt: skip
