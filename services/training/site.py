"""Where a scene's mouth is and whence it is seen: what the bus does not say, as plain numbers."""

from __future__ import annotations

import msgspec

Vec3 = tuple[float, float, float]


class Site(msgspec.Struct, frozen=True, kw_only=True):
    """The duct at rest. `python -m services.scenes.site SCENE` prints one as JSON.

    Attributes
    ----------
    mouth_m, inward, mouth_radius_m
        Middle of the rim, the unit vector that leads in, and the rim's radius.
    eye_m, looks_at_m
        Place and aim of the endoscope; without them nobody is judged for leaving its view.
    basis_hash, rim_gain
        Mean outward way of the rim for each modal coordinate of this basis, in 1/sqrt(kg); empty where not known.
    """

    mouth_m: Vec3
    inward: Vec3
    mouth_radius_m: float
    eye_m: Vec3 | None = None
    looks_at_m: Vec3 | None = None
    basis_hash: str = ""
    rim_gain: tuple[float, ...] = ()
