"""Compile the kernels of all shipped scenes for the fixed target and pack them: ``python deploy/ship_kernels.py OUT``.

A release runs it once for each Python and architecture; `setup.py` puts what it finds in ``build/kernels`` into the
wheel. It does nothing where the archive of exactly these sources is there already.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import pickle
import runpy
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import numba
import trimesh
import zstandard

from trocar.services.kernels import kernel_archive, kernel_cache
from trocar.services.kernels.processor import numba_target, target_name
from trocar.services.kernels.source_closure import Sources
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.runtime.process.process import Options, load_process_config

#: The processes with kernels.
PROCESSES = ("physics", "haptics", "gateway", "visualization")
NEED_A_SURFACE = ("anatomy",)
#: What a program that uses the library compiles, beside what a rig does.
EXAMPLES = ("trocar.examples.poke",)
#: With this word the script is the process that compiles.
COMPILE = "--compile"


def archive_name() -> str:
    """Return the name of the archive for this Python, architecture and source."""
    made = kernel_archive.made_with()
    digests = [Sources(ROOT).digest(f"trocar.services.{name}.__main__") for name in PROCESSES]
    of_sources = kernel_cache.digest_of(json.dumps([made, *digests]))
    return f"{made['processor']}-{sys.implementation.cache_tag}-{of_sources}{kernel_archive.SUFFIX}"


def compile_all(root: Path) -> None:
    """Compile what any shipped scene needs into a kernel cache of its own, in a process that has nothing compiled."""
    environment = {**os.environ, **numba_target(), "NUMBA_CACHE_DIR": str(root), "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, __file__, COMPILE], env=environment, cwd=ROOT, check=True)


def compile_here() -> None:
    """Do what each process does before a rig runs, for every scene; then run the examples."""
    with tempfile.TemporaryDirectory() as folder:
        surface = Path(folder) / "surface.stl"
        write_tube(surface)
        for scene in sorted(path.stem for path in (ROOT / "configs" / "scenes").glob("*.yaml")):
            overrides = (f"duct.mesh_file={surface}",) if scene in NEED_A_SURFACE else ()
            began_s = time.monotonic()
            for name in PROCESSES:
                prepare_process(name, Options("stub", scene, overrides, prepare_only=True))
            print(f"{scene}: {time.monotonic() - began_s:.1f} s", flush=True)
        for example in EXAMPLES:
            sys.argv[1:] = [f"{folder}/picture.png"]
            runpy.run_module(example, run_name="__main__")
    kernel_cache.settle()


def prepare_process(name: str, options: Options) -> None:
    """Prepare a process of a rig, as ``--prepare-only`` does, unless its scene leaves it nothing to do."""
    settings = load_process_config(name, options)
    if name not in settings.requirements.idle:
        with contextlib.redirect_stderr(io.StringIO()):  # its progress
            importlib.import_module(f"trocar.services.{name}.__main__").prepare(settings)


def write_tube(path: Path) -> None:
    """Write a surface for the scenes whose file is the user's: 60 mm long, 9 mm wide."""
    tube = parametric_duct(DuctGeometry(5e-3, 60e-3, n_around=24, n_along=46))
    trimesh.Trimesh(1e3 * tube.vertices_m, tube.triangles).export(path)


def share_indices(root: Path) -> None:
    """Rewrite the indices of a kernel cache so that each kernel is found by any processor that has its target."""
    for index in root.glob("*/*.nbi"):
        with index.open("rb") as file:
            version, (stamp, files) = pickle.load(file), pickle.load(file)
        (processor,) = {key[1] for key in files}
        shared = kernel_archive.shipped_overloads(processor, files)
        index.write_bytes(pickle.dumps(version, protocol=5) + pickle.dumps((stamp, shared), protocol=5))
    for folder in (each for each in root.iterdir() if each.is_dir()):
        kernel_cache.write_hashes(folder)


def pack(root: Path, path: Path) -> None:
    """Write the archive of a kernel cache."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as archive:
        _add(archive, kernel_archive.MADE_WITH, json.dumps(kernel_archive.made_with()).encode())
        for folder in sorted(each for each in root.iterdir() if each.is_dir()):
            for file in sorted(folder.iterdir()):
                _add(archive, f"{folder.name}/{file.name}", file.read_bytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_suffix(".half")
    half.write_bytes(zstandard.ZstdCompressor(level=19, write_checksum=True).compress(plain.getvalue()))
    half.replace(path)


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size, member.mode = len(content), 0o600
    archive.addfile(member, io.BytesIO(content))


def main(argument: str) -> int:
    """Make the archive, unless it is there; archives of other sources are removed."""
    if not target_name():
        print("kernels are compiled for AVX2 and FMA, which this processor lacks", file=sys.stderr)
        return 1
    if argument == COMPILE:
        compile_here()
        return 0
    folder = Path(argument)
    archive = folder / archive_name()
    if archive.exists():
        print(archive)
        return 0
    for old in folder.glob(f"*-{sys.implementation.cache_tag}-*{kernel_archive.SUFFIX}"):
        old.unlink()
    with tempfile.TemporaryDirectory() as root:
        compile_all(Path(root))
        share_indices(Path(root))
        pack(Path(root), archive)
    print(f"{archive}: {archive.stat().st_size / 1e6:.1f} MB, numba {numba.__version__}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
