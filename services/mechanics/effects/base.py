"""What an effect is: settings, what it needs, and the stages of a step in which it acts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

from services.mechanics.arrays import FloatArray

if TYPE_CHECKING:
    from services.mechanics.collision.pairs import ContactPairs
    from services.mechanics.contact.rows import ContactRows
    from services.mechanics.scene import SceneModel
    from services.mechanics.simulation import Simulation
    from services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class NoSettings:
    """An effect without settings."""


class Effect:
    """One physical effect; override only the stages it acts in.

    An effect that a scene does not name is never constructed. The stages that it does not override are never
    called: the simulation keeps one list per stage of the effects that act in it.
    """

    Settings: ClassVar[type[Any]] = NoSettings

    def __init__(self, settings: Any, scene: SceneModel) -> None:
        self.settings = settings
        self.scene = scene
        self.dissipated_j = 0.0
        """Energy that the effect itself has taken out so far, beyond what contact rows do."""

    def potential_energy_j(self, simulation: Simulation) -> float:
        """What the effect and its bodies store now, for the energy books: nothing, unless it says so."""
        return 0.0

    def nodal_load_n(self, mesh: TriangleMesh) -> FloatArray:
        """Before the duct is reduced: a constant load (n, 3) on its nodes, part of its rest shape."""
        raise NotImplementedError

    def prepare(self, simulation: Simulation) -> None:
        """Once, when the bodies exist."""
        raise NotImplementedError

    def add_loads(self, simulation: Simulation, dt_s: float) -> None:
        """Add to the bodies' external loads, which are zero at the start of every step."""
        raise NotImplementedError

    def add_pairs(self, simulation: Simulation, pairs: ContactPairs) -> None:
        """Append candidate pairs of the catheter to those already found."""
        raise NotImplementedError

    def add_rows(self, simulation: Simulation, rows: ContactRows) -> None:
        """Append contact rows of the effect's own bodies or laws."""
        raise NotImplementedError

    def set_limits(self, simulation: Simulation, rows: ContactRows) -> None:
        """Set coefficients of friction, and limits of holds."""
        raise NotImplementedError

    def add_compliance(self, simulation: Simulation, W: FloatArray, dt_s: float) -> None:
        """Add what the effect's own bodies give way to the lower blocks of W, along world axes."""
        raise NotImplementedError

    def after_solve(self, simulation: Simulation, dt_s: float) -> None:
        """Act on the bodies at the end of the step, when contact forces are known."""
        raise NotImplementedError


STAGES = (
    "nodal_load_n",
    "prepare",
    "add_loads",
    "add_pairs",
    "add_rows",
    "set_limits",
    "add_compliance",
    "after_solve",
)


def acts_in(effect: Effect | type[Effect], stage: str) -> bool:
    """Whether the effect overrides this stage."""
    kind = effect if isinstance(effect, type) else type(effect)
    return getattr(kind, stage) is not getattr(Effect, stage)


def read_settings(name: str, kind: type[Effect], values: Mapping[str, object]) -> Any:
    """Build the settings of an effect.

    Raises
    ------
    ValueError
        Naming the key that the effect does not know, and those it knows.
    """
    known = [f.name for f in fields(kind.Settings)]
    for key in values:
        if key not in known:
            raise ValueError(f"effects.{name}: unknown key '{key}'; known: {', '.join(known) or 'none'}")
    try:
        return kind.Settings(**values)
    except TypeError as error:
        raise ValueError(f"effects.{name}: {error}") from error
