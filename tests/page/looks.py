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
from trocar.services.supervisor.page.page_place import DIST

_AXE = DIST.parent / "node_modules" / "axe-core" / "axe.min.js"


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
#: Pairs of elements that lie over each other, but for one that holds the other.
_CROSSING = """((selector) => {
  const shown = [...document.querySelectorAll(selector)].map((node) => [node, node.getBoundingClientRect()])
    .filter(([node, { width }]) => width && node.checkVisibility({ visibilityProperty: true }));
  const kind = (node) => node.id || node.className.baseVal || node.className || node.tagName;
  const name = ([node]) => `${kind(node)} ${node.textContent.slice(0, 30)}`;
  const isOver = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  return shown.flatMap(([one, a], i) => shown.slice(i + 1).filter(([other, b]) => !one.contains(other)
    && !other.contains(one) && isOver(a, b)).map((each) => [name([one]), name(each)]));
})"""
#: Words of charts that lie on other words of the same chart or on one of its curves.
_ON_CURVES = """[...document.querySelectorAll('svg.track')].flatMap((chart) => {
  const texts = [...chart.querySelectorAll('text')].filter((each) => each.textContent);
  const words = texts.map((each) => [each.textContent, each.getBBox()]);
  const inside = (b, x, y) => x > b.x && x < b.x + b.width && y > b.y + 1 && y < b.y + b.height - 1;
  const points = [...chart.querySelectorAll('polyline')].flatMap((line) =>
    Array.from({ length: 400 }, (_, i) => line.getPointAtLength(i / 399 * line.getTotalLength())));
  const crossed = words.filter(([, b]) => points.some(({ x, y }) => inside(b, x, y)));
  const over = words.filter(([, a], i) => words.some(([, b], k) => k > i && a.x < b.x + b.width && b.x < a.x + a.width
    && a.y + 2 < b.y + b.height && b.y + 2 < a.y + a.height));
  return [...crossed, ...over].map(([text]) => text);
})"""


def crossing(browser: Chromium, selector: str) -> list[list[str]]:
    """Return the pairs of shown elements that lie over each other."""
    found: list[list[str]] = browser.evaluate(f"{_CROSSING}({selector!r})")
    return found


def words_on_curves(browser: Chromium) -> list[str]:
    """Return the words of charts that lie on a curve, or on other words."""
    found: list[str] = browser.evaluate(_ON_CURVES)
    return found


def serious_faults(browser: Chromium) -> list[str]:
    """Return what axe finds that is serious or critical."""
    if not browser.evaluate("'axe' in globalThis"):
        browser.evaluate(f"{_AXE.read_text(encoding='utf-8')}; true")
    found = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations'], iframes: false}).then(({violations}) => violations"
        ".filter(({impact}) => ['serious', 'critical'].includes(impact))"
        ".map(({id, nodes}) => [id, ...nodes.slice(0, 3).map((n) => n.target + n.any?.[0]?.message)].join(' ')))"
    )
    return list(found)


def cut_words(browser: Chromium) -> list[str]:
    """Return what of the page has words that do not fit."""
    found: list[str] = browser.evaluate(_CUT)
    return found


def keep_picture(browser: Chromium, what: str, *, whole: bool = False) -> None:
    """Keep a screenshot in the folder that TROCAR_LOOKS names, for who wants to see what was measured."""
    if folder := os.environ.get("TROCAR_LOOKS"):
        browser.screenshot(Path(folder) / f"{re.sub(r'[^a-zA-Z0-9-]+', '_', what)}.png", whole=whole)


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
