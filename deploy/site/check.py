"""Links of a built site: every page, anchor and file that it leads to is there, and every picture can be drawn."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_BEGINS = {".png": b"\x89PNG\r\n\x1a\n", ".jpg": b"\xff\xd8\xff"}


@dataclass
class Page:
    """What a page offers as anchors, and what it leads to."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    pictures: list[str] = field(default_factory=list)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.page = Page()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = {name: value or "" for name, value in attrs}
        self.page.anchors |= {said[name] for name in ("id", "name") if said.get(name)}
        if tag == "img" and "src" in said:
            self.page.pictures.append(said["src"])
        elif tag in ("a", "link") and "href" in said:
            self.page.links.append(said["href"])
        elif tag == "script" and "src" in said:
            self.page.links.append(said["src"])


def read_page(path: Path) -> Page:
    """Return anchors and links of a page of HTML."""
    reader = _Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    return reader.page


def faults(site: Path, repository: str, root: Path) -> list[str]:
    """Return a sentence on each link or picture that leads nowhere.

    Args:
        site: Path. Folder of the built site.
        repository: str. Address of the repository; what links call a file of it must be one.
        root: Path. A checkout of the repository.
    """
    pages = {path.resolve(): read_page(path) for path in sorted(site.rglob("*.html"))}
    if not pages:
        return [f"{site}: there is no page"]
    found = []
    for path, page in pages.items():
        where = path.relative_to(site.resolve())
        found += [f"{where}: {said}" for link in page.links for said in _fault_of(link, path, pages, repository, root)]
        found += [f"{where}: {said}" for picture in page.pictures for said in _fault_of_picture(picture, path)]
    return found


def _fault_of(link: str, path: Path, pages: dict[Path, Page], repository: str, root: Path) -> Iterator[str]:
    if link.startswith(f"{repository}/"):
        kind, _, file = link.removeprefix(f"{repository}/").partition("/main/")
        if kind in ("blob", "tree") and not (root / unquote(file.partition("#")[0])).exists():
            yield f"{link}: the repository has no such file"
        return
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target.is_dir():
        target /= "index.html"
    if not target.is_file():
        yield f"{link}: there is no such page"
    elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
        yield f"{link}: the page has no such anchor"


def _fault_of_picture(picture: str, path: Path) -> Iterator[str]:
    if picture.startswith(("data:", "http:", "https:")):
        return
    file = (path.parent / unquote(picture)).resolve()
    if not file.is_file():
        yield f"{picture}: there is no such picture"
    elif file.suffix == ".svg":
        try:
            ElementTree.parse(file)
        except ElementTree.ParseError as error:
            yield f"{picture}: cannot be drawn: {error}"
    elif not file.read_bytes().startswith(_BEGINS.get(file.suffix, b"")):
        yield f"{picture}: is no {file.suffix[1:]}"
