"""Colour scales beside a window's picture: of the duct's strain and of the force arrows."""

from __future__ import annotations

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingAnnotation import vtkScalarBarActor

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.visualization.drawn_bodies import colour_of_force
from trocar.services.visualization.strain import FULL, colours_of_strain

_SHADES = 64  # neighbours then differ by less than 2 % of the scale, so that no steps are seen


def scales() -> list[vtkScalarBarActor]:
    """Return the scales of stretch and of the force on a tool, whose last colour is for all larger values."""
    strains = colours_of_strain(np.linspace(0.0, FULL, _SHADES)) / 255.0
    forces = np.array([pv.Color(colour_of_force(newton)).float_rgb for newton in (0.5, 1.5, 2.5)])
    return [_bar("stretch, %", strains, 100.0 * FULL, 0.52), _bar("force, N", forces, float(len(forces)), 0.14)]


def _bar(title: str, colours: FloatArray, full: float, bottom: float) -> vtkScalarBarActor:
    """Return a bar with these colours (n, 3) from 0 to `full`, `bottom` of the window's height above its lower edge."""
    bar = vtkScalarBarActor()
    bar.SetLookupTable(pv.LookupTable(values=255.0 * np.insert(colours, 3, 1.0, axis=1), scalar_range=(0.0, full)))
    bar.SetTitle(title)
    bar.SetNumberOfLabels(min(5, len(colours) + 1))
    bar.SetMaximumNumberOfColors(len(colours))
    bar.SetLabelFormat("%.0f")
    bar.SetPosition(0.9, bottom)
    bar.SetWidth(0.075)
    bar.SetHeight(0.3)
    bar.UnconstrainedFontSizeOn()
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.ShallowCopy(pv.TextProperty(font_family="courier", font_size=13, color="white", shadow=False))
    return bar
