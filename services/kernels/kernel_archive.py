"""Kernels that a release has compiled: they travel in the wheel, and are unpacked into the cache when first needed.

They are compiled for the fixed target of `processor`, so every processor that has it runs them. An archive holds the
folders of the kernel cache, each named by a hash of all source that its kernels are made of: what does not fit the
source at hand is never found. What lies in the archive is unpickled and run, so only this user and root may be able to
change it, and each kernel is checked by the hash that lies beside it (`kernel_cache`).
"""

from __future__ import annotations

import fcntl
import functools
import json
import platform
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

from trocar.services.files.cache_directory import make_folders
from trocar.services.files.trusted_path import fault_of_place
from trocar.services.kernels.processor import target_name

#: Where a wheel has its archives; a clone has none.
FOLDER = Path(__file__).parents[2] / "kernels"
#: First member of an archive: what its kernels were made with.
MADE_WITH = "made-with.json"
SUFFIX = ".tar.zst"


class ShippedOverloads(dict[Any, str]):
    """The files of one kernel by signature, in numba's index: those for the fixed target serve all that have it.

    A key of numba's is a signature, the processor, and hashes of the function. In a process that compiles for its own
    processor, as a program of somebody else does, a kernel is found under the name of the target as well.
    """

    processor: tuple[str, str, str] | None = None

    def get(self, key: Any, default: Any = None) -> Any:
        """Return the file of a key, or that of the same key for the fixed target."""
        signature, _, hashes = key
        return super().get(key) or super().get((signature, self.processor, hashes), default)

    def __reduce__(self) -> tuple[object, ...]:
        """Return how it is pickled: as a class of this module, with all that it holds."""
        return shipped_overloads, (self.processor, dict(self))


def shipped_overloads(processor: tuple[str, str, str], files: dict[Any, str]) -> ShippedOverloads:
    """Return the files of one kernel, compiled for a processor in numba's words: triple, name, features."""
    made = ShippedOverloads(files)
    made.processor = processor
    return made


def made_with() -> dict[str, str]:
    """Return what decides whether compiled kernels can be used, besides their source."""
    return {
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "numba": sys.modules["numba"].__version__,
        "llvmlite": sys.modules["llvmlite"].__version__,
        "processor": target_name() or platform.machine(),
    }


@functools.cache
def unpack(root: Path) -> str:
    """Unpack what was shipped into the kernel cache, once; return why this process compiles all the same.

    Empty if everything is there, or nothing was shipped, as in a clone.
    """
    archives = sorted(FOLDER.glob(f"*{SUFFIX}")) if FOLDER.is_dir() else []
    if not archives:
        return ""
    from zstandard import ZstdError  # only a wheel has archives

    try:
        faults = [_unpack_archive(path, root) for path in archives]
    except (OSError, tarfile.TarError, ValueError, ZstdError) as error:
        return f"the kernels that came with the package cannot be read: {error}"
    return "" if "" in faults else faults[0]


def _unpack_archive(path: Path, root: Path) -> str:
    if fault := fault_of_place(path):
        return f"the kernels that came with the package are not used: {fault}"
    if not target_name():
        return "the kernels that came with the package are for processors with AVX2 and FMA, which this one lacks"
    done = root / f"{path.name.removesuffix(SUFFIX)}.unpacked"
    if done.exists():
        return ""
    make_folders(root)
    with (root / "unpacking.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of several processes that start at once, one unpacks
        if done.exists():
            return ""
        if fault := _extract(path, root):
            return fault
        done.touch()
    return ""


def _extract(path: Path, root: Path) -> str:
    """Put the folders of an archive into the cache; those that are there already stay."""
    import zstandard

    with (
        path.open("rb") as packed,
        zstandard.ZstdDecompressor().stream_reader(packed) as plain,
        tarfile.open(fileobj=plain, mode="r|") as archive,
    ):
        first = archive.next()
        text = archive.extractfile(first) if first is not None and first.name == MADE_WITH else None
        if text is None:
            return f"{path}: does not say what its kernels were made with"
        if fault := _difference(json.load(text)):
            return fault
        with tempfile.TemporaryDirectory(prefix=".unpacking-", dir=root) as folder:
            while (member := archive.next()) is not None:
                _write_member(archive, member, Path(folder))
            for each in Path(folder).iterdir():
                if not (root / each.name).exists():
                    each.rename(root / each.name)
    return ""


def _write_member(archive: tarfile.TarFile, member: tarfile.TarInfo, folder: Path) -> None:
    """Write a file of an archive. Raises ValueError if it is anything but a file in a folder of the cache."""
    parts = member.name.split("/")
    content = archive.extractfile(member) if member.isreg() else None
    if content is None or len(parts) != 2 or not all(part.strip(".") for part in parts):
        raise ValueError(f"{member.name!r} is no file of a kernel")
    (folder / parts[0]).mkdir(mode=0o700, exist_ok=True)
    (folder / member.name).write_bytes(content.read())


def _difference(then: dict[str, str]) -> str:
    """Return in what the kernels of an archive differ from what this process needs, empty if in nothing."""
    now = made_with()
    differ = [f"{name} {then.get(name, 'unknown')} (here {now[name]})" for name in now if then.get(name) != now[name]]
    return f"the kernels that came with the package were made with {', '.join(differ)}" if differ else ""
