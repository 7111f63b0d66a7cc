"""The cholangiogram: ducts by X-rays while contrast agent flows out of the catheter's tip.

The lumen lies between the inner faces of the wall. Its contrast is that of `contrast_flow`, injected while the tip is
inside; stones, bubbles and the catheter displace it. Not modelled: the liver's and the gut's resistance (what comes to
an open rim flows out there), layers of agent and bile by weight, and that a wall which moves pumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.review.export.bubbles import Bubbles
from trocar.review.export.contrast_flow import ContrastFlow, steady_flow
from trocar.review.export.displacers import Displacer, displacers
from trocar.review.export.filled_lumen import FilledLumen
from trocar.review.export.fluoroscopy import Fluoroscope
from trocar.review.export.lumen_cells import LumenCells, fan_m
from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.scene.air_bubble import AirBubble
from trocar.services.visualization.picture import Picture, PictureLayout

CONTRAST_1_M = 114.0
"""Attenuation that half-strength agent adds: 150 mg of iodine per ml, 7.58 cm2/g of iodine at 60 keV (NIST XCOM)."""
RATE_M3_S = 0.25e-6
"""Injected per second: a gentle hand, which fills a duct of a millilitre in some seconds; an assumption."""
_LONGEST_S = 0.05
"""Longest step of the flow, in which 12 mm3 come: less than a cell of a lumen that is 5 mm wide."""
EDGE_M = 0.5e-3
"""Longest edge of the lumen's triangles: a cell is then 0.75 mm long, less than a catheter is wide."""


class Cholangioscope(Fluoroscope):
    """Draws layouts and pictures as `Fluoroscope` does, with contrast agent in the lumen.

    Args:
        size: Width and height in pixels.
        tied: Names of rims that are tied, so that nothing flows out there: ``mouth`` or ``clamped``.
        bubbles: Air that comes out of the catheter with the agent.
        gravity_m_s2: (3,). Against which bubbles rise; zero where nothing weighs.

    Attributes:
        flow: ContrastFlow. The agent in the lumen.
        bubbles: Bubbles. The air in it.
        lumen: FilledLumen. The lumen of the last picture.
    """

    def __init__(
        self,
        size: tuple[int, int] = (800, 600),
        tied: frozenset[str] = frozenset(),
        bubbles: Sequence[AirBubble] = (),
        gravity_m_s2: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__(size)
        self._tied = tied
        self._of_catheter, self._gravity_m_s2 = bubbles, gravity_m_s2
        self._rest_m: Float32Array | None = None
        self._tick = 0

    def update(self, layout: PictureLayout, picture: Picture) -> None:
        """Let the agent flow from the last picture to this one, and add up what attenuates each ray."""
        super().update(layout, picture)
        if not len(layout.mouth):
            return
        if layout.rest_m is not self._rest_m or picture.tick < self._tick:
            self._begin(layout, picture.tick)
        tip_m = picture.centreline_m[-1:].astype(float)
        corners_m = self._cells.corners_m(self._inner_face(self._wall_m))
        self.lumen = FilledLumen(self._cells, corners_m, displacers(layout, picture), tip_m, self._outlets)
        passed_s, self._tick = (picture.tick - self._tick) * TICK_S, picture.tick
        if passed_s > 0.0 and len(tip_m):
            self._let_flow(passed_s, tip_m[0])
        self._draw_contrast()

    def _begin(self, layout: PictureLayout, tick: int) -> None:
        """Begin with a lumen without agent."""
        self._rest_m, self._tick = layout.rest_m, tick
        wall_m, normals = np.zeros((2, self._wall.n_points, 3), np.float32)
        self._wall.update(layout.rest_m, wall_m, normals)
        self._cells = LumenCells(self._inner_face(wall_m), self._wall.outer, np.array(layout.mouth), EDGE_M)
        self.flow = ContrastFlow(self._cells.n)
        self.bubbles = Bubbles(self._of_catheter, self._gravity_m_s2)
        self._outlets = self._open_ends({node for name in self._tied for node in getattr(layout, name)})

    def _inner_face(self, wall_m: Float32Array) -> Float32Array:
        """Return the vertices of the wall's inner face, which come behind those of its outer face, in their order."""
        return wall_m[self._wall.n_middle : 2 * self._wall.n_middle]

    def _open_ends(self, tied: set[int]) -> IntArray:
        """Return openings and cells (o, 2) through which agent leaves: not at rims with a tied node."""
        ends = enumerate(zip(self._cells.openings, self._cells.opening_cells, strict=True))
        open_ends = [(k, cell) for k, (rim, cells) in ends if not tied & set(rim.tolist()) for cell in cells]
        return np.array(open_ends, np.int32).reshape(-1, 2)

    def _let_flow(self, passed_s: float, tip_m: FloatArray) -> None:
        """Inject for so long, if the tip (3,) is inside, and move the bubbles."""
        lumen = self.lumen
        if lumen.tip is None and not self.bubbles.inside:
            return
        rate_m3_s = 0.0 if lumen.tip is None else RATE_M3_S
        flow, steps = steady_flow(lumen.channel, lumen.tip or 0, rate_m3_s), int(np.ceil(passed_s / _LONGEST_S))
        for _ in range(steps):
            self.flow.inject(flow, passed_s / steps)
            if lumen.tip is not None:
                self.bubbles.come_out(self.flow.injected_m3, tip_m)
            self.bubbles.move(lumen, flow, passed_s / steps)

    def _draw_contrast(self) -> None:
        """Add what the agent attenuates, less what bodies displace of it."""
        share, lumen, cells = self.flow.share, self.lumen, self._cells
        for cell in np.flatnonzero(share > 0.0):
            self._add(CONTRAST_1_M * share[cell], lumen.corners_m, cells.triangles[cells.cell == cell])
        for cap in cells.borders:
            if (step := share[cap.inner] - share[cap.outer]) != 0.0:
                corners_m = fan_m(lumen.corners_m, cap.edges)
                fan = np.arange(3 * len(corners_m), dtype=np.int32).reshape(-1, 3)
                self._add(CONTRAST_1_M * step, corners_m.reshape(-1, 3), fan)
        for body, inside in zip(lumen.bodies, lumen.cells_of_bodies, strict=True):
            self._take_out(body, inside)
        for body in self.bubbles.displacers():
            self._take_out(body, lumen.cells_at(body.places_m))

    def _take_out(self, body: Displacer, cells: IntArray) -> None:
        """Take out what a body displaces: agent as it is on average in the cells of its places."""
        if (around := float(np.mean(self.flow.share[cells]))) > 0.0:
            self._add(-CONTRAST_1_M * around, body.surface_m, body.triangles)
