"""What is run in another process: a labelled volume of any format, to one label's voxels and what is round them."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trocar.services.anatomy.label_choice import choose_label
from trocar.services.anatomy.volume_geometry import judge_geometry
from trocar.services.meshes.errors import MeshError

MOST_VOXELS = 160_000_000
"""As many as a scan of the whole abdomen has: 512 x 512 x 600."""
MOST_LABELS = 1_000
"""A volume with more different values than these is an image of grey values, no segmentation."""
MARGIN_VOXELS = 4
"""Round the label, for what it borders on."""

Array = npt.NDArray[Any]


@dataclass
class Volume:
    """Layers of labels on one grid; index order is i, j, k, as in the file's header.

    Attributes:
        layers: Arrays (ni, nj, nk) of whole numbers; segments that overlap are in different layers.
        names: (layer, value) to the name of the segment, where the file tells names.
        origin_mm, spacing_mm, directions: Of voxel (0, 0, 0), its sizes (3,), and the axes of i, j, k as columns, LPS.
    """

    layers: list[Array]
    origin_mm: Array
    spacing_mm: Array
    directions: Array
    names: dict[tuple[int, int], str] = field(default_factory=dict)


def read(path: str, label: str | None, wall: str | None) -> Iterator[bytes]:
    """Yield the facts of a label (JSON), its voxels, those of the wall, and the labels beside them (npy).

    Raises MeshError if the volume cannot be read or has no such label; the sentence names the file.
    """
    file = Path(path)
    volume = _read(file)
    judge_geometry(file, volume.origin_mm, volume.spacing_mm, volume.directions)
    segments = _segments(file, volume)
    chosen = choose_label(file, label, segments)
    mask = _mask(volume, chosen)
    if not mask.any():
        raise MeshError(f"{file}: label '{segments[chosen] or chosen[1]}' is empty: no voxel has it")
    walls = [] if wall is None else [choose_label(file, wall, segments)]
    wall_mask = _mask(volume, walls[0]) if walls else np.zeros_like(mask)
    low, high = _box(mask | wall_mask)
    part = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    beside, names = _beside(volume, [chosen, *walls], segments, part)
    facts = {
        "label": segments[chosen] or str(chosen[1]),
        "labels": [segments[each] or str(each[1]) for each in segments],
        "size": list(mask.shape), "low": low, "names": names, "origin_mm": volume.origin_mm.tolist(),
        "spacing_mm": volume.spacing_mm.tolist(), "directions": volume.directions.tolist(),
    }  # fmt: skip
    yield json.dumps(facts).encode()
    for array in (mask[part], wall_mask[part], beside):
        yield _npy(array)


def _read(path: Path) -> Volume:
    if not path.stat().st_size:
        raise MeshError(f"{path}: the file is empty")
    try:
        with path.open("rb") as file:
            head = file.read(132)
        if head[128:] == b"DICM":
            from trocar.services.anatomy.dicom_seg import read_dicom_seg

            return read_dicom_seg(path)
        from trocar.services.anatomy.grid_file import read_grid

        return read_grid(path, head)
    except (MeshError, MemoryError):
        raise
    except ModuleNotFoundError as error:
        raise MeshError(f"{path}: reading it needs the package '{error.name}', install trocar[scan]") from error
    except Exception as error:  # The readers raise whatever a broken file trips them over.
        raise MeshError(f"{path}: not a readable volume ({_last_line(error, path)})") from error


def _last_line(error: Exception, path: Path) -> str:
    """Return what is wrong without the places in the source that the libraries put before it."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    said = [line for line in lines if ".cxx:" not in line and ".cpp:" not in line] or lines
    words = said[-1].replace(f' for "{path}"', "").replace(str(path), "the file").removeprefix("sitk::ERROR:")
    return words.removeprefix("ITK ERROR:").strip().rstrip(".")


def judge_size(path: Path, size: tuple[int, ...]) -> None:
    """Refuse a grid that is no volume, or one of more voxels than are read.

    Raises MeshError that names the file and the size.
    """
    if len(size) != 3:
        shape = " x ".join(map(str, size))
        raise MeshError(f"{path}: has {len(size)} dimensions ({shape}), a segmentation has 3: save one time step of it")
    if np.prod(size, dtype=float) > MOST_VOXELS:
        voxels = np.prod(size, dtype=float)
        raise MeshError(f"{path}: has {voxels:.3g} voxels, at most {MOST_VOXELS:.3g} are read: crop it to the duct")


def whole_numbers(path: Path, values: Array) -> Array:
    """Return the labels of an array; floating-point numbers that are all whole are labels, too.

    Raises MeshError if they are an image's.
    """
    if values.dtype.kind == "f":
        strange = ~np.isfinite(values) | (values != np.round(values))
        if strange.any():
            place = tuple(int(i) for i in np.argwhere(strange)[0])
            raise MeshError(
                f"{path}: is an image and no labels: voxel {place} has the value {float(values[place]):.4g}; segment "
                "it first"
            )
    return values if values.dtype.kind in "ui" else values.astype(np.int64)


def _segments(path: Path, volume: Volume) -> dict[tuple[int, int], str]:
    """Return the names of all segments by layer and value, empty where the file tells none."""
    found: dict[tuple[int, int], str] = {}
    for layer, values in enumerate(volume.layers):
        present = np.unique(np.concatenate([np.unique(plane) for plane in values.transpose()]))
        if len(present) > MOST_LABELS or present[0] < 0:
            raise MeshError(
                f"{path}: is an image and no labels: it has {len(present)} different values from {present[0]} to "
                f"{present[-1]}; segment it first"
            )
        found |= {(layer, int(value)): volume.names.get((layer, int(value)), "") for value in present if value}
    found |= {key: name for key, name in volume.names.items() if key not in found}  # named, and without a voxel
    return found


def _mask(volume: Volume, key: tuple[int, int]) -> Array:
    mask: Array = volume.layers[key[0]] == key[1]
    return mask


def _box(mask: Array) -> tuple[list[int], list[int]]:
    """Return the first index, and that after the last, of a mask's surroundings."""
    low, high = [], []
    for axis in range(3):
        held = np.flatnonzero(mask.any(axis=tuple(a for a in range(3) if a != axis)))
        low.append(max(0, int(held[0]) - MARGIN_VOXELS))
        high.append(min(mask.shape[axis], int(held[-1]) + 1 + MARGIN_VOXELS))
    return low, high


def _beside(
    volume: Volume, chosen: list[tuple[int, int]], segments: dict[tuple[int, int], str], part: tuple[slice, ...]
) -> tuple[Array, list[str]]:
    """Return the number of the other segment at each voxel, 0 for none, and the segments' names by that number."""
    names, beside = [""], np.zeros([s.stop - s.start for s in part], np.uint16)
    for key, name in segments.items():
        if key not in chosen:
            beside[volume.layers[key[0]][part] == key[1]] = len(names)
            names.append(name or f"label {key[1]}")
    return beside, names


def _npy(array: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()
