"""The pages of the site, staged for Sphinx: documents with the links that hold on the site, and pages of the API.

Documents are written for the repository, where a link is a path from the file it stands in. On the site a link to a
file that is a page there leads to that page; to any other file, to that file in the repository, whose address stands
in `pyproject.toml`.
"""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from deploy.site import api

ROOT = Path(__file__).resolve().parents[2]
#: Documents beside `docs` that are pages, and where.
_OTHERS = {
    "CONTRIBUTING.md": "project/contributing.md",
    "CODE_OF_CONDUCT.md": "project/conduct.md",
    "SECURITY.md": "project/security.md",
    "CHANGELOG.md": "project/changelog.md",
    "deploy/README.md": "project/deploy.md",
    "benchmarks/results": "benchmarks/index.md",
}
_PICTURES = (".svg", ".png", ".jpg")
_CODE = re.compile(r"^```.*?^```|^(?: {4}|\t).*?$|`[^`\n]+`", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
_SECTION = re.compile(r"^## (?P<title>[^:\n]+).*?\n(?P<text>.*?)(?=^## |\Z)", re.DOTALL | re.MULTILINE)


class LinkError(Exception):
    """A link of a document leads nowhere; the message names both."""


def repository(root: Path = ROOT) -> str:
    """Return the address of the repository, without a slash at its end."""
    urls = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
    return str(urls["Repository"]).rstrip("/")


def page_of(path: str) -> str | None:
    """Return the place on the site of a file or folder of the repository; None if it is no part of the site."""
    if path in _OTHERS:
        return _OTHERS[path]
    file = PurePosixPath(path)
    for folder, place in (("docs", PurePosixPath()), ("benchmarks/results", PurePosixPath("benchmarks"))):
        if file.is_relative_to(folder) and file.suffix in (".md", *_PICTURES):
            below = place / file.relative_to(folder)
            return str(below.with_name("index.md") if below.name == "README.md" else below)
    return None


def with_links_of_site(text: str, path: str, root: Path = ROOT) -> str:
    """Return a document with links that hold on the site.

    Raises LinkError if one leads to no file of the repository.

    Args:
        text: str. The document, in Markdown.
        path: str. Its file, from the root of the repository.
        root: Path. The root of the repository.
    """

    def other(link: re.Match[str]) -> str:
        return f"]({_link_of_site(link['target'], path, root)})"

    return _outside_code(text, lambda words: _LINK.sub(other, words))


def _outside_code(text: str, change: Callable[[str], str]) -> str:
    kept, at = [], 0
    for code in _CODE.finditer(text):
        kept += [change(text[at : code.start()]), code.group()]
        at = code.end()
    return "".join([*kept, change(text[at:])])


def _link_of_site(target: str, path: str, root: Path) -> str:
    file, _, anchor = target.partition("#")
    if "://" in target or not file or file.startswith("mailto:"):
        return target
    found = os.path.normpath(PurePosixPath(path).parent / file)
    if found.startswith("..") or not (root / found).exists():
        raise LinkError(f"{path}: {target} leads nowhere")
    page, here = page_of(found), page_of(path)
    suffix = f"#{anchor}" if anchor else ""
    if page is None or here is None:
        kind = "tree" if (root / found).is_dir() else "blob"
        return f"{repository(root)}/{kind}/main/{found}{suffix}"
    return os.path.relpath(page, PurePosixPath(here).parent) + suffix


def stage(folder: Path) -> None:
    """Write all pages and pictures of the site as Sphinx reads them."""
    shutil.rmtree(folder, ignore_errors=True)
    for path in _documents():
        text = with_links_of_site(_text(path), path)
        _write(folder, page_of(path), text + _contents(path, text))
    for path in _below("docs", *_PICTURES) + _below("benchmarks/results", *_PICTURES):
        place = folder / str(page_of(path))
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, place)
    _write(folder, "benchmarks/index.md", _benchmarks())
    for name, text in api.pages().items():
        _write(folder, name, text)


def _text(path: str) -> str:
    """Return a document; the index of documents is the site's first page, and says as the README does what this is."""
    text = (ROOT / path).read_text(encoding="utf-8")
    if path != "docs/README.md":
        return text
    about = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## ")[0]
    picture = "![The page of the rig, with the duct, the catheter and two forceps](page.png)"
    _, _, after_title = text.partition("\n")
    return f"{with_links_from_docs(about)}\n{picture}\n{after_title}"


def with_links_from_docs(text: str) -> str:
    """Return words of the README with links as they are written in `docs`."""
    return _LINK.sub(lambda link: link.group() if "://" in link["target"] else f"](../{link['target']})", text)


def _write(folder: Path, name: str | None, text: str) -> None:
    place = folder / str(name)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(text, encoding="utf-8")


def _documents() -> list[str]:
    others = [path for path in _OTHERS if path.endswith(".md")]
    return [*_below("docs", ".md"), *_below("benchmarks/results", ".md"), *others]


def _below(folder: str, *suffixes: str) -> list[str]:
    paths = sorted((ROOT / folder).rglob("*"))
    return [path.relative_to(ROOT).as_posix() for path in paths if path.suffix in suffixes]


def _contents(path: str, text: str) -> str:
    """Return the tables of contents that an index has for the side of the site: what each of its sections lists."""
    if path == "docs/README.md":
        project = [page for page in _OTHERS.values() if page.startswith("project/")]
        return "".join([*_sections(text), _toctree("API", ["api/index"]), _toctree("Project", project)])
    if path == "docs/decisions/README.md":
        return _toctree("", [page for part in _SECTION.finditer(text) for page in _pages_in(part["text"])])
    return ""


def _sections(text: str) -> list[str]:
    parts = [(part["title"], _pages_in(part["text"])) for part in _SECTION.finditer(text)]
    return [_toctree(title, pages) for title, pages in parts if pages]


def _pages_in(text: str) -> list[str]:
    """Return the pages that a list links to, each once, without those that another index lists."""
    targets = [link["target"].partition("#")[0] for link in _LINK.finditer(text)]
    listed = [each for each in targets if "://" not in each and each.endswith(".md")]
    return [each for each in dict.fromkeys(listed) if not each.startswith(("benchmarks/", "../")) or "index" in each]


def _toctree(caption: str, pages: list[str]) -> str:
    head = ["", "```{toctree}", ":hidden:", *([f":caption: {caption}"] if caption else []), ""]
    return "\n".join([*head, *(page.removesuffix(".md") for page in pages), "```", ""])


def _benchmarks() -> str:
    """Return the index of what benchmarks have written."""
    names = [Path(path).stem for path in _below("benchmarks/results", ".md")]
    where = f"{repository()}/tree/main/benchmarks"
    head = f"# Benchmarks\n\nHow long each part takes, as the programs in [benchmarks]({where}) have measured it.\n"
    return "\n".join([head, "```{toctree}", ":titlesonly:", "", *names, "```", ""])
