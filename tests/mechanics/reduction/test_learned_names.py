"""What is kept of a wall is named by all the code that it follows from: changed code does not meet old results."""

import os
import re
import time
from pathlib import Path

import pytest

from tests.conftest import MAKERS
from trocar.services.files.cache_directory import UNUSED_S
from trocar.services.kernels.source_closure import Sources, own_sources
from trocar.services.mechanics.reduction import cache, content_hash
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.meshes.reading import READER

ROOT = Path(__file__).parents[3]
CACHE = ROOT / "services" / "mechanics" / "reduction" / "cache.py"


@pytest.fixture
def name_after(tmp_path, monkeypatch):
    """Return what writes modules into a tree and names an entry that one of them makes, as a fresh process would."""
    (tmp_path / "trocar").mkdir()

    def write(**modules):
        for module, text in modules.items():
            (tmp_path / "trocar" / f"{module}.py").write_text(text)
        monkeypatch.setattr(content_hash, "own_sources", lambda: Sources(tmp_path))
        return entry_name("basis", "trocar.maker", 1.5)

    return write


def test_a_change_of_what_the_maker_imports_changes_the_name_and_no_other_does(name_after):
    before = name_after(maker="def make():\n    from trocar import far", far="x = 1", beside="y = 1")
    assert before.startswith("basis-")
    assert name_after(beside="y = 2") == before
    assert name_after(far="x = 2") != before


def test_every_entry_is_named_by_content_and_code():
    """Whoever asks for an entry is one of the makers, and names as many as it asks for."""
    asks = re.compile(r"(?<!def )\bfetch(?:_record)?\((?:cache_dir|folder)")
    texts = {path: path.read_text() for path in (ROOT / "services").rglob("*.py") if path != CACHE}
    asked = {path: len(asks.findall(text)) for path, text in texts.items() if asks.search(text)}
    assert asked == {path: texts[path].count("entry_name(") for path in asked}
    assert len(asked) == len(MAKERS)


def test_a_mesh_follows_from_the_readers_of_files_too():
    assert "trocar.services.meshes.inp_file" in own_sources().closure(READER)


def test_what_no_run_has_used_for_long_goes_when_another_of_its_kind_is_made(tmp_path):
    made = {
        name: cache.fetch(tmp_path, name, lambda entry: entry.describe(kind="rest"))
        for name in ("rest-1", "rest-2", "mesh-1")
    }
    long_ago_s = time.time() - UNUSED_S - 60.0
    for entry in made.values():
        os.utime(entry.folder, (long_ago_s, long_ago_s))
    cache.fetch(tmp_path, "rest-2", lambda entry: pytest.fail("it is there"))
    cache.fetch(tmp_path, "rest-3", lambda entry: entry.describe(kind="rest"))
    assert {path.name for path in tmp_path.glob("[!.]*")} == {"rest-2", "rest-3", "mesh-1"}
