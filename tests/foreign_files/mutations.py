"""Files as they arrive damaged: bytes flipped, cut, doubled and swapped, counts changed; and what is said of them.

``python -m tests.foreign_files.mutations [SURFACES] [RECORDINGS] [SEED]`` tries that many and prints what was seen.
"""

from __future__ import annotations

import re
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.foreign_files.whole_files import recordings, surfaces
from trocar.services.foreign_files import client
from trocar.services.foreign_files.packets import Ended, Refused
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.loading import SurfaceSettings, load_duct_surface
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import read_inputs
from trocar.services.recordings.reader import read_arrays, read_extras, read_frames
from trocar.services.recordings.repair import repair

MOST_S, MOST_BYTES = 30.0, 1 << 30
_STRANGE = (0, 1, 2, 255, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**32 + 2, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
_NUMBER = re.compile(rb"\d+")
_REASONS = re.compile(r"[^a-z]+")


def _flip(data: bytearray, random: np.random.Generator) -> None:
    for place in random.integers(0, len(data), random.integers(1, 9)):
        data[place] ^= 1 << random.integers(0, 8)


def _overwrite(data: bytearray, random: np.random.Generator) -> None:
    begin, n = int(random.integers(0, len(data))), int(random.integers(1, 200))
    data[begin : begin + n] = random.bytes(len(data[begin : begin + n]))


def _cut(data: bytearray, random: np.random.Generator) -> None:
    del data[int(random.integers(0, len(data))) :]


def _take_out(data: bytearray, random: np.random.Generator) -> None:
    begin = int(random.integers(0, len(data)))
    del data[begin : begin + int(random.integers(1, 1 + len(data) // 4))]


def _double(data: bytearray, random: np.random.Generator) -> None:
    begin, n = int(random.integers(0, len(data))), int(random.integers(1, 1 + len(data) // 4))
    data[begin:begin] = data[begin : begin + n]


def _swap(data: bytearray, random: np.random.Generator) -> None:
    a, b, c = np.sort(random.integers(0, len(data), 3)).tolist()
    data[a:c] = data[b:c] + data[a:b]


def _count_in_text(data: bytearray, random: np.random.Generator) -> None:
    numbers = list(_NUMBER.finditer(data))
    if numbers:
        begin, end = numbers[int(random.integers(0, min(len(numbers), 1000)))].span()
        data[begin:end] = str(_STRANGE[int(random.integers(0, len(_STRANGE)))]).encode()


def _count_in_bytes(data: bytearray, random: np.random.Generator) -> None:
    form = ("<H", "<I", "<Q", ">I")[int(random.integers(0, 4))]
    size, near = struct.calcsize(form), random.random() < 0.5
    if len(data) > size:
        place = int(random.integers(0, min(len(data) - size, 400 if near else len(data))))
        number = _STRANGE[int(random.integers(0, len(_STRANGE)))] % (1 << 8 * size)
        data[place : place + size] = struct.pack(form, number)


_CHANGES: tuple[Callable[[bytearray, np.random.Generator], None], ...] = (
    _flip, _overwrite, _cut, _take_out, _double, _swap, _count_in_text, _count_in_bytes,
)  # fmt: skip


def mutated(whole: bytes, random: np.random.Generator) -> bytes:
    """Return a file with one or two changes."""
    data = bytearray(whole)
    for _ in range(int(random.integers(1, 3))):
        if data:
            _CHANGES[int(random.integers(0, len(_CHANGES)))](data, random)
    return bytes(data)


@dataclass
class Findings:
    """What was seen of how many files."""

    tried: int = 0
    read: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    ended: list[Ended] = field(default_factory=list)
    untold: list[str] = field(default_factory=list)  # by a library's exception
    most_s: float = 0.0

    def check(self) -> None:
        """Fail if a reader took too much."""
        assert self.tried == self.read + self.refused.total()
        assert self.most_s < MOST_S
        assert max(each.memory_bytes for each in self.ended) < MOST_BYTES

    def __str__(self) -> str:
        memory = max(each.memory_bytes for each in self.ended) / (1 << 20)
        cpu_s = max(each.cpu_s for each in self.ended)
        crashed = Counter(each.code for each in self.ended if each.code < 0)
        return (
            f"{self.tried} files: {self.read} read, {self.refused.total()} refused in one sentence each, "
            f"{len(self.ended)} readings; longest {self.most_s:.1f} s ({cpu_s:.1f} s of computing), most memory "
            f"{memory:.0f} MiB, readers ended by signals {dict(crashed)}; with 95 % fewer than {3 / self.tried:.2%} do "
            f"otherwise\n{self.refused.most_common(40)}\n{self.untold[:20]}"
        )


@contextmanager
def followed(findings: Findings) -> Iterator[None]:
    """Note how each reader ends."""
    judge = client._Answer._judge

    def follow(answer: client._Answer, ended: Ended, refused: Refused | None) -> None:
        findings.ended.append(ended)
        if refused is not None and not refused.is_told:
            findings.untold.append(f"{refused.kind}: {refused.trace[-300:]}")
        judge(answer, ended, refused)

    client._Answer._judge = follow  # type: ignore[method-assign]
    try:
        yield
    finally:
        client._Answer._judge = judge  # type: ignore[method-assign]


def _is_sentence(text: str, path: Path) -> bool:
    return path.name in text and "\n" not in text and "Traceback" not in text and len(text) < 3000


def try_surface(path: Path, findings: Findings) -> None:
    """Load a surface as a scene does."""
    _try(path, findings, lambda: load_duct_surface(path, SurfaceSettings("mm")), MeshError)


def try_recording(path: Path, findings: Findings) -> None:
    """Read a recording as every verb does, and mend it."""

    def read() -> None:
        refused: list[RecordingError] = []
        for do in (_all_frames, read_extras, lambda path: read_arrays(path, "duct.npz"), read_inputs, repair):
            try:
                do(path)  # type: ignore[operator]
            except RecordingError as error:
                refused.append(error)
        assert all(_is_sentence(str(each), path) for each in refused), refused
        if refused:
            raise refused[0]

    _try(path, findings, read, RecordingError)


def _all_frames(path: Path) -> None:
    for _ in read_frames(path):
        pass


def _try(path: Path, findings: Findings, read: Callable[[], object], kind: type[Exception]) -> None:
    began_s = time.monotonic()
    findings.tried += 1
    said = ""
    try:
        read()
        findings.read += 1
    except kind as error:
        said = str(error)
        findings.refused[_REASONS.sub(" ", said.partition(": ")[2])[:40]] += 1
    assert not said or _is_sentence(said, path), said
    findings.most_s = max(findings.most_s, time.monotonic() - began_s)


def campaign(
    wholes: dict[str, bytes], attempt: Callable[[Path, Findings], None], n: int, folder: Path, seed: int
) -> Findings:
    """Try so many changed files, each whole one in turn."""
    random, findings, names = np.random.default_rng(seed), Findings(), list(wholes)
    with followed(findings):
        for k in range(n):
            name = names[k % len(names)]
            path = folder / f"{k}-{name}"
            path.write_bytes(mutated(wholes[name], random))
            try:
                attempt(path, findings)
            except BaseException:
                path.rename(folder / f"failed-{name}")
                raise
            path.unlink(missing_ok=True)
    findings.check()
    return findings


if __name__ == "__main__":
    counts = [int(word) for word in sys.argv[1:]] + [5000, 5000, 0][len(sys.argv) - 1 :]
    with tempfile.TemporaryDirectory() as place:
        if counts[0]:
            print("surfaces:", campaign(surfaces(), try_surface, counts[0], Path(place), counts[2]), flush=True)
        if counts[1]:
            whole = recordings(Path(place))
            print("recordings:", campaign(whole, try_recording, counts[1], Path(place), counts[2]), flush=True)
