"""Runs as files: numbers in quanta, second differences along time, compressed."""

from __future__ import annotations

import io
import json
import lzma
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .observe import QUANTA, RAGGED, Run

FOLDER = Path(__file__).parent / "recorded"


@dataclass(frozen=True)
class Record:
    """A recorded run, and the kind of machine that made it."""

    machine: str
    run: Run


def save(name: str, machine: str, run: Run) -> Path:
    """Write a run; values are rounded to their quanta, checksums and counts are exact."""
    arrays: dict[str, npt.NDArray[np.generic]] = {"checksum": run.checksum}
    for key, values in run.values.items():
        steps = np.rint(values / QUANTA[key]).astype(np.int64) if key in QUANTA else values.astype(np.int64)
        arrays[f"value.{key}"] = _lanes(steps, 0 if key in RAGGED else 2)
        arrays[f"shape.{key}"] = np.array(values.shape)
    for key, counts in run.counts.items():
        arrays[f"count.{key}"] = counts.astype(np.int32)
    buffer = io.BytesIO()
    np.savez(buffer, machine=np.frombuffer(json.dumps(machine).encode(), np.uint8), **arrays)
    path = FOLDER / f"{name}.npz.xz"
    FOLDER.mkdir(exist_ok=True)
    path.write_bytes(lzma.compress(buffer.getvalue(), preset=9))
    return path


def load(name: str) -> Record:
    """Read what `save` wrote."""
    with np.load(io.BytesIO(lzma.decompress((FOLDER / f"{name}.npz.xz").read_bytes()))) as stored:
        values = {}
        for key in (k.removeprefix("shape.") for k in stored.files if k.startswith("shape.")):
            steps = _unlanes(stored[f"value.{key}"], tuple(stored[f"shape.{key}"]), 0 if key in RAGGED else 2)
            values[key] = steps * QUANTA[key] if key in QUANTA else steps
        counts = {k.removeprefix("count."): stored[k] for k in stored.files if k.startswith("count.")}
        machine = json.loads(stored["machine"].tobytes())
        return Record(machine, Run(stored["checksum"], values, counts))


def _lanes(steps: npt.NDArray[np.int64], order: int) -> npt.NDArray[np.uint8]:
    """Differences along time, quantity by quantity, byte by byte: what compresses well."""
    flat = steps.reshape(len(steps), -1)
    for _ in range(order):
        flat = np.diff(flat, axis=0, prepend=0)
    zigzag = ((flat << 1) ^ (flat >> 63)).T
    return np.ascontiguousarray(zigzag).view(np.uint8).reshape(-1, 8).T.copy()


def _unlanes(lanes: npt.NDArray[np.uint8], shape: tuple[int, ...], order: int) -> npt.NDArray[np.int64]:
    zigzag = np.ascontiguousarray(lanes.T).view(np.uint64).reshape(-1, shape[0])
    flat = ((zigzag >> np.uint64(1)).astype(np.int64) ^ -(zigzag & np.uint64(1)).astype(np.int64)).T
    for _ in range(order):
        flat = np.cumsum(flat, axis=0)
    return flat.reshape(shape)
