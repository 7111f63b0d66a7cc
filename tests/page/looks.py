"""At which sizes, in which colours and languages the page is looked at, and what of a look can be measured."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.by_day import by_day
from tests.chromium import Chromium


class Look(NamedTuple):
    """A scheme of colours, a size in pixels, and a language."""

    scheme: str
    width: int
    height: int
    language: str = "en"

    def __str__(self) -> str:
        return f"{self.width}-{self.scheme}-{self.language}"


#: What is cut hangs on the size and on the language, as German words are longer; what cannot be read on the scheme.
_BY_DAY = [Look("light", 390, 844), Look("light", 1280, 800), Look("light", 1920, 1080), Look("dark", 1280, 800)]
_GERMAN = [Look("light", 390, 844, "de"), Look("dark", 1280, 800, "de")]
_OTHERS = [Look("dark", 390, 844), Look("dark", 1920, 1080)]
LOOKS = by_day([*_BY_DAY, *_GERMAN], [(each,) for each in _OTHERS])
#: Words that do not fit into their place; what scrolls, or is cut with three dots on purpose, need not, nor force bars.
_CUT = """[...document.querySelectorAll(
  'button, select, .badge, h1, h2, h3, th, td, label, summary, p, li')].filter((node) => {
  const { width } = node.getBoundingClientRect(), style = getComputedStyle(node);
  return width && style.textOverflow !== 'ellipsis' && !node.closest('.scroll, pre, #tools')
    && style.display !== 'inline' && node.scrollWidth > node.clientWidth + 1;
}).map((node) => node.id || `${node.tagName} ${node.innerText.slice(0, 40)}`)"""


def cut_words(browser: Chromium) -> list[str]:
    """Return what of the page has words that do not fit."""
    found: list[str] = browser.evaluate(_CUT)
    return found


def keep_picture(browser: Chromium, what: str) -> None:
    """Keep a screenshot in the folder that TROCAR_LOOKS names, for who wants to see what was measured."""
    if folder := os.environ.get("TROCAR_LOOKS"):
        browser.screenshot(Path(folder) / f"{re.sub(r'[^a-zA-Z0-9-]+', '_', what)}.png")


def set_language(browser: Chromium, language: str) -> None:
    """Choose the page's language; it holds once the page is loaded anew."""
    browser.evaluate(f"localStorage.setItem('trocar-language', '{language}')")


@contextmanager
def looked_at(browser: Chromium, look: Look) -> Iterator[None]:
    """Give the browser the size and scheme of a look, and put them back."""
    browser.set_size(look.width, look.height)
    browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": look.scheme}])
    try:
        time.sleep(0.3)  # a page in motion is measured wrongly
        yield
    finally:
        browser.set_size(1280, 800)
        browser.command("Emulation.setEmulatedMedia", features=[])
