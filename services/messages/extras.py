"""How to get a package that an extra of Trocar's brings: a command that works from a clone, a wheel and an index."""

from __future__ import annotations

import re
import shlex
import sys

#: Extras by the package that is missed, as it is imported.
EXTRAS = {
    "av": "video",
    "distributed": "cluster",
    "evdev": "hands",
    "foxglove": "foxglove",
    "SimpleITK": "scan",
    "gymnasium": "envs",
    "highdicom": "scan",
    "matplotlib": "study",
    "meshio": "mesh",
    "psycopg": "postgres",
    "pyacvd": "mesh",
    "pyarrow": "parquet",
    "pydicom": "scan",
    "pyvista": "view",
    "serial": "serial",
    "trimesh": "mesh",
}


def requirements_of(extra: str) -> list[str]:
    """Return what the installed Trocar says that an extra needs, empty where it is not installed or knows no such."""
    from importlib import metadata  # at a refusal only

    try:
        told = metadata.requires("trocar") or []
    except metadata.PackageNotFoundError:
        return []
    marked = re.compile(rf"""extra == ["']{re.escape(extra)}["']""")
    return [each.partition(";")[0].strip() for each in told if marked.search(each)]


def how_to_get(package: str | None) -> str:
    """Return a command that installs a missing package, with all others of the extra that it belongs to."""
    extra = EXTRAS.get((package or "").partition(".")[0], "")
    wanted = requirements_of(extra) if extra else []
    python = shlex.quote(sys.executable or "python")
    return f"{python} -m pip install {' '.join(map(shlex.quote, wanted or [package or 'trocar']))}"
