"""Kernels that come with the package are run without a compiler, or a sentence says why not."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard

from deploy import ship_kernels
from tests.kernels.kernel_checkout import make_checkout
from trocar.services.kernels.kernel_archive import MADE_WITH, SUFFIX
from trocar.services.kernels.processor import numba_target, target_name

ASK = "from trocar.services.caller import outer; print(outer({}), sum(outer.stats.cache_misses.values()))"
TARGET = numba_target()


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an archive of kernels, compiled in another folder by another cache."""
    folder = tmp_path_factory.mktemp("shipped")
    made, cache = make_checkout(folder / "made"), folder / "cache"
    assert _run(made, cache, **TARGET)[0] == (20, 1)
    ship_kernels.share_indices(cache)
    ship_kernels.pack(cache, _archive(made))
    return _archive(made)


@pytest.fixture
def package(shipped: Path, tmp_path: Path) -> Path:
    """Return an installed package that came with its kernels."""
    package = make_checkout(tmp_path / "package")
    _archive(package).parent.mkdir()
    shutil.copy(shipped, _archive(package))
    return package


def _archive(package: Path) -> Path:
    return package / "trocar" / "kernels" / f"for-this{SUFFIX}"


def _run(package: Path, cache: Path, argument: str = "1", **variables: str) -> tuple[tuple[float, int], str]:
    """Return what the kernel says, how often it was compiled, and what was told."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(package), "NUMBA_CACHE_DIR": str(cache), **variables}
    command = [sys.executable, "-c", ASK.format(argument)]
    done = subprocess.run(command, env=environment, cwd=package, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    value, misses = done.stdout.split()
    return (float(value), int(misses)), done.stderr


@pytest.mark.parametrize("variables", [TARGET, {}], ids=["as a rig", "for the processor at hand"])
def test_nothing_is_compiled(package: Path, tmp_path: Path, variables: dict[str, str]) -> None:
    """Neither in a process of a rig nor in somebody's program, which compiles for its own processor."""
    for _ in range(2):
        assert _run(package, tmp_path / "new", **variables) == ((20, 0), "")


def test_what_was_not_shipped_is_compiled_beside_it(package: Path, tmp_path: Path) -> None:
    new = tmp_path / "new"
    assert _run(package, new, "1.5") == ((25, 1), "")
    assert _run(package, new, "1.5") == ((25, 0), "")
    assert _run(package, new, "1") == ((20, 0), "")


def test_processes_that_start_at_once_unpack_once_and_compile_nothing(package: Path, tmp_path: Path) -> None:
    environment = {**os.environ, **TARGET, "PYTHONPATH": str(package), "NUMBA_CACHE_DIR": str(tmp_path / "new")}
    command = [sys.executable, "-c", ASK.format("1")]
    running = [
        subprocess.Popen(command, env=environment, cwd=package, stdout=subprocess.PIPE, text=True) for _ in range(5)
    ]
    assert [process.communicate()[0] for process in running] == ["20 0\n"] * 5


def _rewrite(archive: Path, change: Callable[[dict[str, bytes]], None]) -> None:
    """Change the members of an archive, by name."""
    plain = zstandard.ZstdDecompressor().decompress(archive.read_bytes(), max_output_size=1 << 28)
    members: dict[str, bytes] = {}
    with tarfile.open(fileobj=io.BytesIO(plain)) as old:
        for member in old:
            file = old.extractfile(member)
            assert file is not None
            members[member.name] = file.read()
    change(members)
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as new:
        for name, content in members.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            new.addfile(member, io.BytesIO(content))
    archive.write_bytes(zstandard.ZstdCompressor().compress(out.getvalue()))


@pytest.mark.parametrize("name", ["Python", "numba", "llvmlite", "processor"])
def test_what_was_made_with_something_else_is_compiled_and_the_sentence_names_it(
    package: Path, tmp_path: Path, name: str
) -> None:
    def change(members: dict[str, bytes]) -> None:
        members[MADE_WITH] = json.dumps(json.loads(members[MADE_WITH]) | {name: "0.0"}).encode()

    _rewrite(_archive(package), change)
    answer, told = _run(package, tmp_path / "new", **TARGET)
    assert answer == (20, 1)
    assert f"were made with {name} 0.0 (here " in told
    assert len(told.splitlines()) == 1


def test_a_flipped_bit_in_a_kernel_is_not_run(package: Path, tmp_path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        (name,) = (name for name in members if name.endswith(".nbc") and "caller" in name)
        code = members[name]
        members[name] = code[:-40] + bytes([code[-40] ^ 1]) + code[-39:]

    _rewrite(_archive(package), change)
    answer, told = _run(package, tmp_path / "new", **TARGET)
    assert answer == (20, 1)
    assert "is not as it was stored" in told


def test_a_name_that_leads_out_of_the_cache_is_refused(package: Path, tmp_path: Path) -> None:
    _rewrite(_archive(package), lambda members: members.update({"../../outside": b"x"}))
    answer, told = _run(package, tmp_path / "new", **TARGET)
    assert answer == (20, 1)
    assert "cannot be read" in told
    assert not list(tmp_path.rglob("outside"))


@pytest.mark.parametrize("content", [b"", b"no archive", zstandard.ZstdCompressor().compress(b"no tar" * 400)])
def test_what_is_no_archive_is_told(package: Path, tmp_path: Path, content: bytes) -> None:
    _archive(package).write_bytes(content)
    answer, told = _run(package, tmp_path / "new", **TARGET)
    assert answer == (20, 1)
    assert "the kernels that came with the package cannot be read" in told


def test_what_others_can_change_is_not_used(package: Path, tmp_path: Path) -> None:
    _archive(package).chmod(0o666)
    answer, told = _run(package, tmp_path / "new", **TARGET)
    assert answer == (20, 1)
    assert "are not used: " in told


@pytest.mark.parametrize(("flags", "name"), [("sse4_2 avx", ""), ("", "")])
def test_a_processor_without_the_target_compiles_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: str, name: str
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text(f"processor : 0\nflags : {flags}\n")
    assert target_name(cpuinfo) == name
    assert target_name(tmp_path / "none") == ""


def test_every_arm_of_64_bits_has_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    assert target_name(tmp_path / "none") == "generic"
