"""The example for people runs, and its number is right."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "docs" / "examples" / "hanging_catheter.py"


def test_hanging_catheter_drops_by_what_beam_theory_says(capsys):
    runpy.run_path(str(EXAMPLE))
    rest_mm, swing_mm = (float(number) for number in re.findall(r"([\d.]+) mm", capsys.readouterr().out))
    outer, inner, length = 1.67e-3, 1.0e-3, 0.1
    # q L^4 / (8 EI), the tube's area and second moment written out; a drop of a few percent of L is still linear
    weight_n_m = 1100 * 9.81 * 3.14159 / 4 * (outer**2 - inner**2)
    bending = 100e6 * 3.14159 / 64 * (outer**4 - inner**4)
    assert rest_mm == pytest.approx(1e3 * weight_n_m * length**4 / (8 * bending), rel=0.01)
    assert 1.5 * rest_mm < swing_mm < 2.0 * rest_mm
