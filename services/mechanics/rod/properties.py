"""Properties of a catheter: stiffnesses, mass and damping per segment, from a material or given directly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray


@dataclass(frozen=True)
class RodProperties:
    """A slender isotropic rod of equal segments; every stiffness may vary along it.

    Attributes:
        n_segments, length_m, radius_m: Segments (at least 2), rest length and outer radius of the rod.
        axial_stiffness_n: EA, a number or one per segment.
        bending_stiffness_n_m2: EI, a number, one per segment, or (n_segments, 2) at both ends of each segment, where it
            is not the same all along a segment; a joint takes the series (harmonic) mean of the ends that it connects.
        linear_density_kg_m: rho A, a number or one per segment.
        torsional_stiffness_n_m2: GJ, given as EI is, or None: then the rod has no material frame at all.
        internal_damping_s: beta of a Kelvin-Voigt material: the stress has an additional part, beta times modulus times
            strain rate. A mode of angular frequency omega has the damping ratio beta omega / 2. It conserves linear and
            angular momentum.
        viscous_drag_n_s_m2: The paper's -b v, per metre of rod: force per length and velocity relative to the
            surroundings at rest.
        rest_curvature_1_m: (n_segments - 1, 3) per joint in the material frame: curvature about m1, about m2, and twist
            rate about the tangent; None is a straight rod. It needs ``torsional_stiffness_n_m2``, because it rotates
            with the material.
    """

    n_segments: int
    length_m: float
    radius_m: float
    axial_stiffness_n: float | FloatArray
    bending_stiffness_n_m2: float | FloatArray
    linear_density_kg_m: float | FloatArray
    torsional_stiffness_n_m2: float | FloatArray | None = None
    internal_damping_s: float = 0.0
    viscous_drag_n_s_m2: float = 0.0
    rest_curvature_1_m: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check that all quantities have a physical meaning. Raises ValueError that names the offending one."""
        if self.n_segments < 2:
            raise ValueError(f"n_segments is {self.n_segments}; a rod needs at least 2 segments")
        for name in ("length_m", "radius_m", "linear_density_kg_m", "axial_stiffness_n"):
            _require(name, self.per_segment(name), positive=True)
        for name in ("internal_damping_s", "viscous_drag_n_s_m2"):
            _require(name, self.per_segment(name), positive=False)
        _require("bending_stiffness_n_m2", self.per_end("bending_stiffness_n_m2"), positive=False)
        if self.torsional_stiffness_n_m2 is not None:
            _require("torsional_stiffness_n_m2", self.per_end("torsional_stiffness_n_m2"), positive=True)
        self._check_rest_curvature()

    def _check_rest_curvature(self) -> None:
        if self.rest_curvature_1_m is None:
            return
        if self.torsional_stiffness_n_m2 is None:
            raise ValueError("rest_curvature_1_m turns with the material: give torsional_stiffness_n_m2 too")
        shape = np.shape(self.rest_curvature_1_m)
        if shape != (self.n_segments - 1, 3) or not np.all(np.isfinite(self.rest_curvature_1_m)):
            raise ValueError(f"rest_curvature_1_m must be finite, of shape ({self.n_segments - 1}, 3), not {shape}")
        across_1_m = np.linalg.norm(np.asarray(self.rest_curvature_1_m)[:, :2], axis=1)
        if across_1_m[sharpest := int(np.argmax(across_1_m))] * self.radius_m > 1.0:
            raise ValueError(
                f"rest_curvature_1_m bends joint {sharpest} to a radius of {1e3 / across_1_m[sharpest]:.3g} mm, below "
                f"the rod's own of {1e3 * self.radius_m:.3g} mm"
            )

    @property
    def n_particles(self) -> int:
        """Number of particles on the centreline, one more than segments."""
        return self.n_segments + 1

    @property
    def segment_length_m(self) -> float:
        """Rest length of each segment."""
        return self.length_m / self.n_segments

    def per_segment(self, name: str) -> FloatArray:
        """Return one value per segment of a quantity given as a number or an array.

        Raises ValueError if the array has another length than there are segments.
        """
        value = np.asarray(getattr(self, name), dtype=np.float64)
        if value.ndim and value.shape != (self.n_segments,):
            raise ValueError(f"{name} has shape {value.shape}; give a number or one per segment ({self.n_segments},)")
        return np.ascontiguousarray(np.broadcast_to(value, (self.n_segments,)))

    def per_end(self, name: str) -> FloatArray:
        """Return the values (n_segments, 2) of a stiffness at both ends of each segment.

        Raises ValueError if an array has another shape than (n_segments,) or (n_segments, 2).
        """
        value = np.asarray(getattr(self, name), dtype=np.float64)
        if value.shape == (self.n_segments, 2):
            return np.ascontiguousarray(value)
        return np.repeat(self.per_segment(name)[:, None], 2, axis=1)

    def particle_mass_kg(self) -> FloatArray:
        """Return the lumped masses (n,), half of each neighbouring segment; their sum is the mass of the rod."""
        return self._lump(self.per_segment("linear_density_kg_m"))

    def particle_drag_n_s_m(self) -> FloatArray:
        """Return the viscous drag coefficients (n,), lumped like the mass."""
        return self._lump(self.per_segment("viscous_drag_n_s_m2"))

    def _lump(self, per_length: FloatArray) -> FloatArray:
        half = 0.5 * self.segment_length_m * per_length
        return np.concatenate((half[:1], half[:-1] + half[1:], half[-1:]))

    def sound_m_s(self) -> float:
        """Return the largest speed of sound along the rod, sqrt(EA / rho A)."""
        stiffness, density = self.per_segment("axial_stiffness_n"), self.per_segment("linear_density_kg_m")
        return float(np.sqrt(np.max(stiffness / density)))

    def joint_stiffness_n_m(self, name: str = "bending_stiffness_n_m2") -> FloatArray:
        """Return the moment per radian (n_segments - 1,) of the inner joints, EI/l: two half segments in series."""
        stiffness = self.per_end(name)
        before, after = stiffness[:-1, 1], stiffness[1:, 0]
        total = before + after
        series = np.divide(2.0 * before * after, total, out=np.zeros_like(total), where=total > 0.0)
        return np.asarray(series / self.segment_length_m)


@dataclass(frozen=True)
class RoundTube:
    """A round tube of one material; an inner diameter of 0 is a solid rod."""

    outer_diameter_m: float
    inner_diameter_m: float
    youngs_modulus_pa: float
    density_kg_m3: float
    poisson_ratio: float = 0.45

    def area_m2(self) -> float:
        """Return the cross section A."""
        return float(np.pi / 4.0 * (self.outer_diameter_m**2 - self.inner_diameter_m**2))

    def second_moment_m4(self) -> float:
        """Return I = pi (d_o^4 - d_i^4) / 64; the polar moment of a round section is 2 I."""
        return float(np.pi / 64.0 * (self.outer_diameter_m**4 - self.inner_diameter_m**4))

    def torsional_stiffness_n_m2(self) -> float:
        """Return GJ of the round section, J = 2 I."""
        shear_modulus_pa = self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))
        return 2.0 * self.second_moment_m4() * shear_modulus_pa

    def rod(
        self,
        n_segments: int,
        length_m: float,
        *,
        twist: bool = False,
        internal_damping_s: float = 0.0,
        viscous_drag_n_s_m2: float = 0.0,
    ) -> RodProperties:
        """Return a rod of this tube; ``twist`` adds its GJ, else the rod has no material frame."""
        inertia = self.second_moment_m4()
        return RodProperties(
            n_segments,
            length_m,
            0.5 * self.outer_diameter_m,
            axial_stiffness_n=self.youngs_modulus_pa * self.area_m2(),
            bending_stiffness_n_m2=self.youngs_modulus_pa * inertia,
            linear_density_kg_m=self.density_kg_m3 * self.area_m2(),
            torsional_stiffness_n_m2=self.torsional_stiffness_n_m2() if twist else None,
            internal_damping_s=internal_damping_s,
            viscous_drag_n_s_m2=viscous_drag_n_s_m2,
        )


def _require(name: str, values: FloatArray, *, positive: bool) -> None:
    if not np.all(np.isfinite(values)) or np.any(values < 0.0) or (positive and np.any(values == 0.0)):
        raise ValueError(f"{name} must be finite and {'positive' if positive else 'not negative'}")
