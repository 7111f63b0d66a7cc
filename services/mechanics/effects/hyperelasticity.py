"""Hyperelasticity: tissue that stiffens as it is stretched, by a law of the membrane out of a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trocar.services.mechanics.effects.base import recipe_of, require_positive
from trocar.services.mechanics.effects.wall_term import WallTerm
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples, fetch_samples
from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS, law_number
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class HyperelasticitySettings:
    """A law of the membrane and its parameters: those of `reduction.membrane_laws`, usual where not given.

    ``exponent`` is that of Fung's law: at a uniaxial stretch e the wall is exp(a e^2) times as stiff as at rest.

    Arteries have about 1, up to strains of 1 (rabbit carotid, b1 = 0.99: Chuong and Fung, Journal of Biomechanical
    Engineering 105:268, 1983). Bile ducts stiffen exponentially too, but already within a stretch of 0.1 to 0.25 (Duch
    2004), which needs a larger exponent; 20 is an assumption.
    """

    law: str = "fung"
    exponent: float = 20.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_positive(self, "exponent")
        law_number(self.law)
        self.beyond_linear()

    def beyond_linear(self) -> BeyondLinear:
        """Return the law; ValueError where a parameter makes no sense."""
        own = {"exponent": self.exponent} if "exponent" in MEMBRANE_LAWS[self.law].parameters else {}
        return BeyondLinear.of(self.law, **{**own, **self.parameters})


class Hyperelasticity(WallTerm):
    """The wall's membrane stiffens with its linear strain in the modes, which include those of the stretched wall.

    The residual beyond the modes stays linear. The force is the gradient of an energy that begins beyond the square of
    the strain, so the wall is linear for small loads. It is implicit, hence stable however stiff the wall is. Where the
    wall is viscoelastic the stiffening relaxes by the same series.
    """

    Settings = HyperelasticitySettings
    can_rest = True

    @property
    def stretch_law(self) -> BeyondLinear:
        """The law, whose stretched wall needs modes."""
        law: BeyondLinear = self.settings.beyond_linear()
        return law

    def train(self, duct: ReducedDuct, progress: Progress) -> None:
        """Choose the triangles that sample the wall, unless they are in the cache."""
        self._fetch(duct, progress)

    def prepare(self, world: World) -> None:
        """Bring the wall's term, at rest."""
        self.take_terms(world).samples = self._fetch(world.duct.reduced)

    def rest(self) -> None:
        """Begin to fade the stiffening out."""
        self._terms.fade("membrane", 1.0)

    def wake(self) -> None:
        """Begin to fade the stiffening in."""
        self._terms.fade("membrane", 0.0)

    @property
    def rests(self) -> bool:
        """Whether the wall does not stiffen at all."""
        return float(self._terms.step.membrane.faded[0]) == 1.0

    def _fetch(self, duct: ReducedDuct, progress: Progress = ignore_progress) -> StretchSamples:
        recipe = recipe_of(duct, "hyperelasticity")
        return fetch_samples(recipe, duct.basis, self.settings.beyond_linear(), duct.cache_dir, progress)
