"""Labels from NRRD (also `.seg.nrrd` of 3D Slicer), NIfTI, MetaImage and whatever else SimpleITK reads."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import numpy.typing as npt
import SimpleITK

from trocar.services.anatomy.volume_file import Volume, judge_size, whole_numbers
from trocar.services.meshes.announced import cut_off
from trocar.services.meshes.errors import MeshError

_SEGMENT = re.compile(r"Segment(\d+)_(Name|LabelValue|Layer)")
_HEADER_BYTES = 1 << 20
_NIFTI_BYTES = 348  # of the header by the NIfTI-1 standard, which is also its first number


def read_grid(path: Path, head: bytes) -> Volume:
    """Read a volume, the header first.

    Raises MeshError if it is no volume of labels; a RuntimeError of the library if it is broken.
    """
    if head.startswith(b"NRRD"):
        _judge_nrrd(path)
    elif _is_nifti(path):
        _judge_nifti(path)
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    size = reader.GetSize()
    while len(size) > 3 and size[-1] == 1:
        size = size[:-1]
    judge_size(path, size)
    image = reader.Execute()
    if image.GetDimension() > 3:
        image = SimpleITK.Extract(image, [*size, *(0,) * (image.GetDimension() - 3)])
    names, layers = _segment_names(image), _layers(path, image)
    return Volume(
        layers, np.array(image.GetOrigin()), np.array(image.GetSpacing()),
        np.array(image.GetDirection()).reshape(3, 3), names,
    )  # fmt: skip


def _layers(path: Path, image: SimpleITK.Image) -> list[npt.NDArray[Any]]:
    values = SimpleITK.GetArrayFromImage(image)  # k, j, i, and the layers of 3D Slicer last
    if image.GetNumberOfComponentsPerPixel() == 1:
        return [whole_numbers(path, values.transpose())]
    if not any(_SEGMENT.fullmatch(key) for key in image.GetMetaDataKeys()):
        raise MeshError(
            f"{path}: each voxel has {values.shape[-1]} values: an image in colour or of vectors, no labels"
        )
    return [whole_numbers(path, values[..., c].transpose()) for c in range(values.shape[-1])]


def _segment_names(image: SimpleITK.Image) -> dict[tuple[int, int], str]:
    """Return the names that 3D Slicer writes into the header, by layer and value."""
    told: dict[int, dict[str, str]] = {}
    for key in image.GetMetaDataKeys():
        if match := _SEGMENT.fullmatch(key):
            told.setdefault(int(match[1]), {})[match[2]] = image.GetMetaData(key)
    segments = [each for _, each in sorted(told.items()) if "Name" in each]
    return {(int(each.get("Layer", 0)), int(each.get("LabelValue", 1))): each["Name"] for each in segments}


def _is_nifti(path: Path) -> bool:
    return path.name.lower().endswith((".nii", ".nii.gz"))


def _judge_nrrd(path: Path) -> None:
    """Refuse a header whose vectors are no numbers: the library takes some of them for 1."""
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES).partition(b"\n\n")[0].decode("utf-8", "replace")
    for line in header.splitlines():
        key = line.partition(":")[0].strip().lower()
        if key in ("space directions", "spacings", "space origin") and re.search(r"\b(nan|inf)", line, re.IGNORECASE):
            if key == "spacings" and re.search(r"\bnan\b", line, re.IGNORECASE) and "list" in header:
                continue
            raise MeshError(f"{path}: the header's '{key}' holds no number: {line.partition(':')[2].strip()}")


def _judge_nifti(path: Path) -> None:
    """Refuse voxel sizes that are no numbers, and a file that is cut off.

    The library takes 1 for such sizes, and 0 for voxels that are not there.
    """
    import gzip

    with gzip.open(path, "rb") if path.name.lower().endswith(".gz") else path.open("rb") as file:
        header = file.read(_NIFTI_BYTES)
        if len(header) < _NIFTI_BYTES:
            raise cut_off(path, _NIFTI_BYTES, "bytes of a header", len(header))
        order = "<" if header[:4] == _NIFTI_BYTES.to_bytes(4, "little") else ">"
        sizes = np.frombuffer(header, f"{order}f4", 3, offset=80)
        if not np.isfinite(sizes).all() or (sizes == 0.0).any():
            raise MeshError(f"{path}: the header's voxel sizes are {sizes.tolist()} mm")
        held = _NIFTI_BYTES + _count_bytes(path, cast(BinaryIO, file))
    n_axes = int(np.frombuffer(header, f"{order}i2", 1, offset=40)[0])
    axes = np.frombuffer(header, f"{order}i2", 7, offset=42)[: max(0, min(n_axes, 7))].astype(np.int64)
    bits = int(np.frombuffer(header, f"{order}i2", 1, offset=72)[0])
    begins = int(np.frombuffer(header, f"{order}f4", 1, offset=108)[0])
    announced = begins + int(np.prod(axes)) * bits // 8
    if held < announced:
        raise cut_off(path, announced, "bytes", held)


def _count_bytes(path: Path, file: BinaryIO) -> int:
    """Return how many bytes follow."""
    try:
        return sum(len(block) for block in iter(lambda: file.read(1 << 20), b""))
    except (EOFError, OSError, zlib.error) as error:
        raise MeshError(f"{path}: the file is cut off or broken ({error})") from None
