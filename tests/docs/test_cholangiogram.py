"""The figure of a cholangiogram: areas against a picture made up, and the file that is kept."""

import re

import numpy as np

from tests.docs.cholangiogram import FIGURE, GREYS, SCALE, WORDS, figure


def test_a_square_is_an_area_of_its_grey() -> None:
    grey = np.full((40, 60), 255.0)
    grey[10:20, 15:40] = 100.0
    paths = re.findall(r'<path fill="#(..)\1\1"[^>]*d="M(\d+),(\d+)l([^"z]*)z"', figure(grey))
    (line,) = [each[1:] for each in paths if 98.5 < int(each[0], 16) < 118.5]
    ways = np.array([line[:2], *(each.split(",") for each in line[2].split())], int)
    corners = np.cumsum(ways, axis=0)
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose(low, (SCALE * 15, SCALE * 10), atol=SCALE)
    np.testing.assert_allclose(high, (SCALE * 39, SCALE * 19), atol=SCALE)


def test_the_kept_figure_is_small_and_has_all_greys_and_words() -> None:
    text = FIGURE.read_text()
    assert len(text) < 30_000
    assert text.count("<path") == len(GREYS) - 1
    assert all(f">{word}</text>" in text for word, *_ in WORDS)
