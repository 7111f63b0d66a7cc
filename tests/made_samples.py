"""Recordings made as the samples are, by the code of today: the samples may be of an older version."""

from __future__ import annotations

from pathlib import Path

from benchmarks.make_samples import Sample, pack

FOLDER = Path(__file__).parents[1] / "docs" / "examples" / "recordings"
SUCCESS, MISS = (FOLDER / f"insertion-{name}.mcap" for name in ("success", "miss"))


def make_sample(path: Path, ticks: int, scene: str = "insertion") -> Path:
    """Make a recording of so many ticks of a scene."""
    whole = path.with_suffix(".whole.mcap")
    Sample(scene, whole).run(ticks)
    pack(whole, path)
    whole.unlink()
    return path
