"""Site of a scene's mouth and viewpoint as plain numbers, which the bus does not contain."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from trocar.services.files.cache_directory import cache_directory
from trocar.services.runtime.config.scene_findings import find_in_scene
from trocar.services.runtime.errors import ConfigError

Values = NDArray[np.float64]
Indices = NDArray[np.integer[Any]]
Vec3 = tuple[float, float, float]


class Site(msgspec.Struct, frozen=True, kw_only=True):
    """The duct at rest.

    Attributes:
        mouth_m, inward, mouth_radius_m: Middle of the rim, the unit vector into the duct, and the rim's radius.
        eye_m, looks_at_m: Position and aim of the endoscope; without them leaving the view is not judged.
        basis_hash, rim_gain: Mean outward displacement of the rim per modal coordinate of this basis, in 1/sqrt(kg);
            empty if unknown.
        ways: Paths from the mouth to each named end, see `trocar.services.meshes.tube_paths`.
        clip_m, clip_reach_m, clip_inward: Middle of a clip on the duct, how far from there what touches the duct is
            under it, and the unit vector along the duct; without a clip jaws at the mouth stand for one.
    """

    mouth_m: Vec3
    inward: Vec3
    mouth_radius_m: float
    eye_m: Vec3 | None = None
    looks_at_m: Vec3 | None = None
    basis_hash: str = ""
    rim_gain: tuple[float, ...] = ()
    ways: dict[str, tuple[Vec3, ...]] = {}
    clip_m: Vec3 | None = None
    clip_reach_m: float = 0.0
    clip_inward: Vec3 = (0.0, 0.0, 0.0)

    def check_branch(self, name: str) -> None:
        """Raise a ConfigError for a branch that the duct has no path to."""
        if name and name not in self.ways:
            raise ConfigError(f"goal.branch: the duct has no end {name!r}; it has: {', '.join(self.ways) or 'none'}")


_MODULE = "trocar.services.scenes.duct_file"
_WAY, _CLIP = "way_", "place_clip"
_NEAREST, _FURTHEST = 2.0, 3.5
"""Ring of the wall from whose middle the way inward is taken, in radii of the mouth: beyond its own flare, before a
bend."""
_EYE = 0.85, 0.95, 0.95
"""Position of the page's endoscope in lengths of the duct: along it, beside it and up, as in `stage.js` (`scope`)."""


def site_of_duct(vertices_m: Values, triangles: Indices, modes: Values, basis_hash: str) -> Site:
    """Return the site of a duct from the data of a recording's `duct.npz`.

    Raises ValueError if it has no free open end.

    Args:
        vertices_m, triangles: (n, 3) and (t, 3).
        modes: (n, 3, m), zero at the held end.
    """
    rims = [rim for rim in _rims(triangles) if np.abs(modes[rim]).max() > 0.0]
    if not rims:
        raise ValueError("the duct has no open end that moves")
    rim = max(rims, key=lambda each: float(np.abs(modes[each]).mean()))
    mouth = vertices_m[rim].mean(axis=0)
    out = vertices_m[rim] - mouth
    away_m = np.linalg.norm(out, axis=1)
    radius_m = float(away_m.mean())
    distance_m = np.linalg.norm(vertices_m - mouth, axis=1)
    ring = vertices_m[(distance_m > _NEAREST * radius_m) & (distance_m < _FURTHEST * radius_m)] - mouth
    inward = ring.mean(axis=0) if len(ring) else vertices_m.mean(axis=0) - mouth
    inward /= np.linalg.norm(inward)
    across = out - np.outer(out @ inward, inward)
    across /= np.linalg.norm(across, axis=1)[:, None]
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    aim = 0.55 * 0.5 * (low + high) + 0.45 * mouth
    side = np.cross(-inward, [0.0, 0.0, 1.0])
    side /= max(float(np.linalg.norm(side)), 1e-9)
    along, beside, up = _EYE
    eye = aim + np.linalg.norm(high - low) * (-along * inward + beside * side + up * np.array([0.0, 0.0, 1.0]))
    return Site(
        mouth_m=_three(mouth),
        inward=_three(inward),
        mouth_radius_m=radius_m,
        eye_m=_three(eye),
        looks_at_m=_three(aim),
        basis_hash=basis_hash,
        rim_gain=tuple((np.einsum("ij,ijm->m", across, modes[rim]) / len(rim)).tolist()),
    )


def read_site(attachment: bytes) -> Site:
    """Return the site of a recording's attachment `duct.npz`.

    Raises ValueError if it is invalid.
    """
    try:
        with np.load(io.BytesIO(attachment), allow_pickle=False) as data:
            arrays = [data[name] for name in ("vertices_m", "triangles", "modes", "basis_hash")]
            ways = {name.removeprefix(_WAY): data[name] for name in data.files if name.startswith(_WAY)}
            clip = data[_CLIP].astype(float) if _CLIP in data.files else None
    except (OSError, KeyError, EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"duct.npz cannot be read: {error}") from None
    vertices_m, triangles, modes, basis_hash = arrays
    n = len(vertices_m) if vertices_m.ndim == 2 else 0
    inside = triangles.dtype.kind == "i" and triangles.size > 0 and 0 <= triangles.min() <= triangles.max() < n
    if not inside or vertices_m.shape != (n, 3) or triangles.shape[1:] != (3,) or modes.shape[:1] != (n,):
        raise ValueError("duct.npz: its arrays are not those of a surface")
    if not (np.isfinite(vertices_m).all() and np.isfinite(modes).all()) or modes.size % (3 * n):
        raise ValueError("duct.npz: its arrays are not finite, or modes do not fit the vertices")
    if not all(
        way.ndim == 2 and way.shape[1] == 3 and len(way) > 1 and np.isfinite(way).all() for way in ways.values()
    ):
        raise ValueError("duct.npz: a way through it is none")
    if clip is not None and not (clip.shape == (7,) and np.isfinite(clip).all()):
        raise ValueError("duct.npz: its clip has no place")
    site = site_of_duct(vertices_m, triangles, modes.reshape(len(vertices_m), 3, -1).astype(float), str(basis_hash))
    site = msgspec.structs.replace(site, ways={name: tuple(map(_three, way)) for name, way in ways.items()})
    if clip is None:
        return site
    return msgspec.structs.replace(
        site, clip_m=_three(clip[:3]), clip_reach_m=float(clip[3]), clip_inward=_three(clip[4:])
    )


def find_site(scene: str, overrides: Sequence[str] = ()) -> Site:
    """Return the site of a scene, for live judging without the mechanics.

    Raises ConfigError: one sentence, if the scene is invalid.
    """
    try:
        return find_in_scene(_MODULE, scene, overrides, _read_kept)
    except ValueError as error:
        raise ConfigError(f"{scene}: {error}") from None


def _read_kept(attachment: bytes) -> Site:
    """Return the site of a duct whose basis is in the cache, as a rebuilt basis may differ."""
    site = read_site(attachment)
    bases = cache_directory() / "bases"
    if not any(site.basis_hash in manifest.read_text() for manifest in bases.glob("basis-*/manifest.json")):
        raise ValueError(f"there is no basis {site.basis_hash} in {bases}")
    return site


def _rims(triangles: Indices) -> list[Indices]:
    """Return the vertices of each loop of boundary edges."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    single, times = np.unique(edges, axis=0, return_counts=True)
    a, b = single[times == 1].T
    label = np.arange(int(triangles.max()) + 1)
    while (label[a] != label[b]).any():  # propagate the smallest vertex index along each loop
        least = np.minimum(label[a], label[b])
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
    at = np.unique(np.concatenate([a, b]))
    return [at[label[at] == each] for each in np.unique(label[at])]


def _three(vector: Values) -> Vec3:
    x, y, z = vector.tolist()
    return x, y, z
