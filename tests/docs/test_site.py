"""The site's parts: links that hold on it, docstrings as Sphinx reads them, and a check that finds what is broken.

`./dev docs --check` builds all of it, where a warning is an error, and follows its links.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from deploy.site.api import pages, plain_to_rst
from deploy.site.check import faults
from deploy.site.stage import LinkError, page_of, repository, stage, with_links_of_site
from tests.docs.reference import ROOT

ADDRESS = repository()


@pytest.mark.parametrize(
    ("link", "on_site"),
    [
        ("wire.md", "wire.md"),
        ("wire.md#versions", "wire.md#versions"),
        ("#below", "#below"),
        ("../README.md", "../index.md"),
        ("../../benchmarks/results/peers.md", "../benchmarks/peers.md"),
        ("../../benchmarks/results", "../benchmarks/index.md"),
        ("../../CONTRIBUTING.md#a-release", "../project/contributing.md#a-release"),
        ("../../README.md#commands", f"{ADDRESS}/blob/main/README.md#commands"),
        ("../../trocar/examples", f"{ADDRESS}/tree/main/trocar/examples"),
        ("../examples/pinched_duct.py", f"{ADDRESS}/blob/main/docs/examples/pinched_duct.py"),
        ("https://example.org/a.md", "https://example.org/a.md"),
    ],
)
def test_a_link_leads_to_the_page_or_to_the_repository(link: str, on_site: str) -> None:
    assert with_links_of_site(f"See [it]({link}).", "docs/reference/cli.md") == f"See [it]({on_site})."


@pytest.mark.parametrize("link", ["gone.md", "../../../secret.md", "../gone/"])
def test_a_link_that_leads_nowhere_is_an_error(link: str) -> None:
    with pytest.raises(LinkError, match=r"^docs/reference/cli\.md: "):
        with_links_of_site(f"[it]({link})", "docs/reference/cli.md")


@pytest.mark.parametrize("code", ["`[a](gone.md)`", "    [a](gone.md)", "```\n[a](gone.md)\n```"])
def test_code_is_left_alone(code: str) -> None:
    text = f"Words.\n\n{code}\n\nMore [words](wire.md).\n"
    assert with_links_of_site(text, "docs/reference/cli.md") == text


def test_every_document_has_a_page_of_its_own(tmp_path: Path) -> None:
    stage(tmp_path)
    documents = [path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")]
    places = [page_of(path) for path in documents]
    assert len(set(places)) == len(places) > 50
    assert not [place for place in places if place is None or not (tmp_path / place).is_file()]


def test_every_module_of_the_mechanics_is_told_of_once() -> None:
    lines = [line for text in pages().values() for line in text.splitlines() if line.startswith(".. automodule::")]
    told = [line.split()[-1] for line in lines]
    files = [path for path in (ROOT / "services" / "mechanics").rglob("*.py") if path.parent.name != "mechanics"]
    modules = {".".join(("trocar", *path.relative_to(ROOT).with_suffix("").parts)) for path in files}
    assert {name.removesuffix(".__init__") for name in modules} <= set(told)
    assert len(told) == len(set(told))


@pytest.mark.parametrize(
    ("plain", "rst"),
    [
        ("A `name` and ``another``.", "A ``name`` and ``another``."),
        ("2 * 3, *args, |x| and q_", r"2 \* 3, \*args, \|x\| and q\_"),
        ("with *stress* on it, :math:`x_1`", "with *stress* on it, ``x_1``"),
        ("Do:\n\n    a = b_\n\n    c\n\nThen.", "Do:\n\n::\n\n    a = b_\n\n    c\n\n\nThen."),
        ("Args:\n    x: float. Of `y`\n        or z_.", "Args:\n    x: float. Of ``y``\n        or z\\_."),
    ],
)
def test_a_docstring_says_the_same_to_sphinx(plain: str, rst: str) -> None:
    assert plain_to_rst(plain) == rst


def _site(folder: Path, body: str) -> list[str]:
    (folder / "index.html").write_text(f"<html><body><h1 id='top'>T</h1>{body}</body></html>")
    (folder / "other.html").write_text("<a name='here' href='index.html#top'>back</a>")
    (folder / "good.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (folder / "bad.svg").write_text("<svg>")
    (folder / "bad.png").write_text("no picture")
    return faults(folder, ADDRESS, ROOT)


@pytest.mark.parametrize(
    "body",
    [
        "<a href='other.html#here'>x</a><a href='#top'>x</a><img src='good.svg'><a href='https://example.org/x'>x</a>",
        f"<a href='{ADDRESS}/blob/main/README.md#x'>x</a><a href='{ADDRESS}/tree/main/services'>x</a>",
    ],
)
def test_a_site_whose_links_lead_somewhere_has_no_faults(tmp_path: Path, body: str) -> None:
    assert not _site(tmp_path, body)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("<a href='gone.html'>x</a>", "index.html: gone.html: there is no such page"),
        ("<a href='other.html#gone'>x</a>", "index.html: other.html#gone: the page has no such anchor"),
        ("<a href='#gone'>x</a>", "index.html: #gone: the page has no such anchor"),
        ("<script src='gone.js'></script>", "index.html: gone.js: there is no such page"),
        ("<link href='gone.css'>", "index.html: gone.css: there is no such page"),
        ("<img src='gone.svg'>", "index.html: gone.svg: there is no such picture"),
        ("<img src='bad.svg'>", "index.html: bad.svg: cannot be drawn"),
        ("<img src='bad.png'>", "index.html: bad.png: is no png"),
        (f"<a href='{ADDRESS}/blob/main/gone.md'>x</a>", "the repository has no such file"),
    ],
)
def test_what_leads_nowhere_is_found(tmp_path: Path, body: str, said: str) -> None:
    (fault,) = _site(tmp_path, body)
    assert said in fault


def test_a_site_without_pages_is_a_fault(tmp_path: Path) -> None:
    assert faults(tmp_path, ADDRESS, ROOT)
