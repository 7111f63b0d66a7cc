"""Local force models, computed from solved reactions, that the servo evaluates between frames."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.protocol.arrays import Array
from trocar.protocol.bodies.haptics import (
    MODEL_ANGLE0,
    MODEL_B,
    MODEL_COLUMNS,
    MODEL_CONTACT,
    MODEL_F0,
    MODEL_GRASP_B,
    MODEL_GRASP_K,
    MODEL_K,
    MODEL_RATE0,
    MODEL_TORQUE,
    MODEL_V0,
    MODEL_X0,
)
from trocar.protocol.bodies.physics import (
    REACTION_COLUMNS,
    REACTION_FORCE,
    REACTION_GRASP_STIFFNESS,
    REACTION_GRASP_TORQUE,
    REACTION_OPENING,
    REACTION_POSITION,
    REACTION_STIFFNESS,
)
from trocar.services.haptics.instruments import HANDLE_RATE, INSTRUMENT_COLUMNS, VELOCITY
from trocar.services.haptics.reactions import is_held
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene import ProbeScene, ToolScene
from trocar.services.mechanics.scene.tools import N_TOOLS

#: Largest number of instruments in a device frame; those without a tool in the scene get the free model.
_MOST = 8


class ModelInputs(Struct):
    """Inputs and output of the models' kernel."""

    reactions: Annotated[FloatArray, N_TOOLS, REACTION_COLUMNS]
    instruments: Annotated[FloatArray, N_TOOLS, INSTRUMENT_COLUMNS]
    coupling_stiffness: Annotated[FloatArray, N_TOOLS]
    coupling_damping: Annotated[FloatArray, N_TOOLS]
    jaw_damping: Annotated[FloatArray, N_TOOLS]
    jaw_ratio: Annotated[FloatArray, N_TOOLS]
    jaw_max_angle: Annotated[FloatArray, N_TOOLS]
    models: Annotated[FloatArray, _MOST, MODEL_COLUMNS]


inputs_at = reader(ModelInputs)


class LocalModels:
    """Models ``f = f0 - K (x - x0) - B (v - v0)`` of tools and jaws, about the hands' states at the solve.

    K is the local stiffness at the tool from physics, virtual coupling included, so the wall feels right although the
    force is a tick or two old. B is the coupling's damping and resists the present velocity. A tool without contact
    gets the free model, of zero force. A handle beyond the stops of its jaws does not move them, so the torque there is
    constant.

    Args:
        tools: Those of the scene.
        reactions: (2, REACTION_COLUMNS), instruments: (2, INSTRUMENT_COLUMNS). Live tables of solved forces and of the
            hands' states.
    """

    def __init__(self, tools: tuple[ToolScene, ...], reactions: FloatArray, instruments: FloatArray) -> None:
        each = (*tools, *(ProbeScene(),) * (N_TOOLS - len(tools)))
        ranges = np.array([tool.handle_range for tool in each])
        self._n_tools = len(tools)
        self._felt = ModelInputs(
            reactions=reactions,
            instruments=instruments,
            coupling_stiffness=np.array([f.coupling_stiffness_n_m for f in each]),
            coupling_damping=np.array([f.coupling_damping_n_s_m for f in each]),
            jaw_damping=np.array([tool.jaws.jaw_damping_nm_s_rad if tool.jaws else 0.0 for tool in each]),
            jaw_ratio=ranges[:, 0].copy(),
            jaw_max_angle=ranges[:, 1].copy(),
            models=np.zeros((_MOST, MODEL_COLUMNS)),
        )
        self._models = self._felt.models

    def table(self, n_instruments: int, *, touching: bool) -> Array:
        """Return the models of ``n_instruments`` in wire format; all are free unless ``touching``."""
        write_models(self._felt.address, min(n_instruments, self._n_tools) if touching else 0)
        return Array("<f8", (n_instruments, MODEL_COLUMNS), self._models[:n_instruments].tobytes())


@kernel
def write_models(address: Address[ModelInputs], n: int) -> None:
    """Write the models of those of the first ``n`` tools that have contact, and zeros for all others."""
    felt = inputs_at(address)
    models = felt.models
    for row in range(models.shape[0]):
        for column in range(models.shape[1]):
            models[row, column] = 0.0
    for tool in range(n):
        if is_held(felt.reactions, tool):
            _write_model(felt, tool)


@inlined_kernel
def _write_model(felt: ModelInputs, tool: int) -> None:
    """Write the model of a tool in contact."""
    solved, moves, model = felt.reactions[tool], felt.instruments[tool], felt.models[tool]
    for axis in range(3):
        model[MODEL_F0 + axis] = solved[REACTION_FORCE + axis]
        model[MODEL_X0 + axis] = solved[REACTION_POSITION + axis]
        model[MODEL_V0 + axis] = moves[VELOCITY + axis]
    for entry in range(9):
        model[MODEL_K + entry] = solved[REACTION_STIFFNESS + entry]
    scale = felt.coupling_damping[tool] / felt.coupling_stiffness[tool] ** 2
    felt_damping(solved[REACTION_STIFFNESS : REACTION_STIFFNESS + 9], scale, model[MODEL_B : MODEL_B + 9])
    ratio, asked = felt.jaw_ratio[tool], solved[REACTION_OPENING]
    moves_jaws = ratio if 0.0 < asked < felt.jaw_max_angle[tool] else 0.0
    model[MODEL_TORQUE] = solved[REACTION_GRASP_TORQUE] * ratio
    model[MODEL_GRASP_K] = max(0.0, solved[REACTION_GRASP_STIFFNESS]) * moves_jaws**2
    model[MODEL_GRASP_B] = felt.jaw_damping[tool] * moves_jaws**2
    model[MODEL_ANGLE0] = asked / ratio
    model[MODEL_RATE0] = moves[HANDLE_RATE]
    model[MODEL_CONTACT] = 1.0


@inlined_kernel
def felt_damping(stiffness: FloatArray, scale: float, out: FloatArray) -> None:
    r"""Write the damping (9,) in N s/m felt by the hand: the coupling's, in series with the touched body.

    Coupling :math:`K_c + b s` and world :math:`K_w` in series are :math:`K + B s` for slow hands, with
    :math:`K = K_c K_w / (K_c + K_w)` and :math:`B = b\, (K / K_c)^2`: a compliant body yields to the damper too. In
    three directions :math:`B = b K K^T / K_c^2`, positive semi-definite; ``scale`` is :math:`b / K_c^2`. At a stiff
    wall that is all of b. At a soft one the full b would only amplify the encoders' noise, to 10 mN where a catheter
    pushes with 30 mN.
    """
    for i in range(3):
        for j in range(3):
            product = 0.0
            for k in range(3):
                product += stiffness[3 * i + k] * stiffness[3 * j + k]
            out[3 * i + j] = product * scale
