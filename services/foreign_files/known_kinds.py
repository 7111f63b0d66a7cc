"""What a file is that is not what was asked for: told by its first bytes."""

from __future__ import annotations

import re

_PACKED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"7z\xbc\xaf": "7z",
           b"\x28\xb5\x2f\xfd": "zstd"}  # fmt: skip
_BEGINS = (
    (re.compile(rb"version https://git-lfs"), "a pointer of Git LFS, fetch the file itself: `git lfs pull`"),
    (re.compile(rb"(\.\.?/)*[\w./]*annex/objects/"), "a pointer of git-annex, fetch the file itself: `git annex get`"),
    (re.compile(rb"\s*(<!doctype html|<html)", re.IGNORECASE), "a web page: what was saved is not the file"),
    (re.compile(rb"#ROSBAG V"), "a bag of ROS 1"),
    (re.compile(rb"SQLite format 3\0"), "a database of SQLite, as bags of ROS 2 are"),
    (re.compile(rb"# vtk DataFile"), "a VTK file of the old kind, save it as .vtp"),
    (re.compile(rb"\s*(c?off)\s", re.IGNORECASE), "an OFF file"),
    (re.compile(rb"ISO-10303-21"), "a STEP file, which has no triangles"),
)


def find_known_kind(head: bytes) -> str:
    """Return what a file is that begins with `head`, empty where that is not known."""
    for magic, packer in _PACKED.items():
        if head.startswith(magic):
            return f"a file packed with {packer}, unpack it first"
    return next((what for begins, what in _BEGINS if begins.match(head)), "")
