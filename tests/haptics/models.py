"""The local model that haptics makes of one reaction, by its names."""

from __future__ import annotations

import numpy as np

from trocar.protocol.bodies import InstrumentState, LocalModel, ToolReaction
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.haptics.instruments import InstrumentTable
from trocar.services.haptics.local_model import LocalModels
from trocar.services.haptics.reactions import Reactions
from trocar.services.mechanics.scene import ForcepsScene


def local_model(
    reaction: ToolReaction, instrument: InstrumentState, forceps: ForcepsScene, *, touching: bool
) -> LocalModel:
    """Return the model of a tool that is the second of two, beside one that nothing was solved for."""
    reactions, instruments = Reactions(), InstrumentTable(2)
    reactions.take_table(reaction_table((ToolReaction(), reaction)))
    other = InstrumentState(name="other", position_m=(0.0, 0.0, 0.0), velocity_m_s=(9.0, 9.0, 9.0))
    instruments.take_states((other, instrument))
    of_both = LocalModels((ForcepsScene(jaw_ratio=9.0), forceps), reactions.rows, instruments.rows)
    free, model = of_both.table(2, touching=touching).view()
    np.testing.assert_array_equal(free, 0.0)
    return LocalModel.from_row(model)
