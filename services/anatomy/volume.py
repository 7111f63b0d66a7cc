"""The voxels of one label, where they lie in the patient, and what lies beside them."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trocar.services.foreign_files import Refusal, ask_once
from trocar.services.foreign_files.limits import Limits
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.meshes.announced import judge_place
from trocar.services.meshes.errors import MeshError

_MODULE = "trocar.services.anatomy.volume_file"
_LIMITS = Limits(memory_bytes=6 << 30, cpu_s=240.0, wait_s=600.0, answer_bytes=2 << 30)
"""By the most voxels that are read: a packed file says nothing of them."""
VOLUME_ENDINGS = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd", ".dcm", ".dicom")

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class LabelVolume:
    """A box of voxels round a label; lengths in metres, in the patient's LPS axes.

    Attributes:
        mask, wall: (ni, nj, nk) bool. The label, and that of the wall, empty without one.
        beside, names: (ni, nj, nk) uint16. The number of another segment at each voxel, and their names; 0 is none.
        origin_m, spacing_m: (3,) float64. Of voxel (0, 0, 0) of the box, and a voxel's sizes.
        directions: (3, 3) float64. Axes of i, j, k as columns.
        low, size: Index of the box's first voxel in the file's volume, and that volume's size.
        label, labels: The label's name or number, and all there are.
    """

    mask: Mask
    wall: Mask
    beside: npt.NDArray[np.uint16]
    names: list[str]
    origin_m: FloatArray
    spacing_m: FloatArray
    directions: FloatArray
    low: list[int]
    size: list[int]
    label: str
    labels: list[str]

    def place_m(self, index: npt.NDArray[Any]) -> FloatArray:
        """Return the places (n, 3) in the patient of indices (n, 3) in the box; whole numbers are voxels' centres."""
        place: FloatArray = self.origin_m + (np.asarray(index, dtype=np.float64) * self.spacing_m) @ self.directions.T
        return place

    def index(self, place_m: FloatArray) -> FloatArray:
        """Return the indices (n, 3) in the box, not rounded, of places (n, 3)."""
        index: FloatArray = (place_m - self.origin_m) @ self.directions / self.spacing_m
        return index

    def at_border(self) -> Mask:
        """Return which voxels of the label lie at the border of the file's volume."""
        at = np.zeros_like(self.mask)
        for axis in range(3):
            for end, is_there in ((0, self.low[axis] == 0), (-1, self._reaches(axis))):
                if is_there:
                    at[(slice(None),) * axis + (end,)] = True
        return at & self.mask

    def _reaches(self, axis: int) -> bool:
        return bool(self.low[axis] + self.mask.shape[axis] == self.size[axis])


def is_volume(path: Path) -> bool:
    """Return whether a file's name, or its first bytes, are a volume's."""
    if path.name.lower().endswith(VOLUME_ENDINGS):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(132)
    except OSError:
        return False
    return head.startswith(b"NRRD") or head[128:] == b"DICM"


def read_volume(path: Path, label: str | None, wall: str | None) -> LabelVolume:
    """Read a label of a volume, in another process with limits.

    Raises MeshError if the volume cannot be read or has no such label; the sentence names the file and the reason.
    """
    judge_place(path)
    try:
        told, mask, walls, beside = ask_once(_MODULE, "read", path, _LIMITS, label=label, wall=wall)
    except Refusal as error:
        raise MeshError(str(error)) from error
    facts = json.loads(told)
    spacing_m, directions = 1e-3 * np.array(facts["spacing_mm"]), np.array(facts["directions"])
    origin_m = 1e-3 * np.array(facts["origin_mm"]) + (np.array(facts["low"]) * spacing_m) @ directions.T
    return LabelVolume(
        _array(mask), _array(walls), _array(beside), facts["names"], origin_m, spacing_m, directions,
        facts["low"], facts["size"], facts["label"], facts["labels"],
    )  # fmt: skip


def _array(npy: bytes) -> npt.NDArray[Any]:
    array: npt.NDArray[Any] = np.load(io.BytesIO(npy), allow_pickle=False)
    return array
