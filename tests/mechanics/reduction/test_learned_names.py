"""What is kept of a wall is named by all the code that it follows from: changed code does not meet old results."""

import os
import re
import time
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import MAKERS
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


@pytest.fixture
def three_entries(tmp_path, monkeypatch):
    """Return a folder with three entries of 8 kB and room for three, the first of them used last, an hour ago."""
    monkeypatch.setattr(cache, "KEPT_BYTES", 30_000)
    an_hour_ago_s = time.time() - 3600.0
    for age_s, name in enumerate(("rest-1", "mesh-2", "rest-3")):
        entry = cache.fetch(tmp_path, name, _fill)
        os.utime(entry.folder, (an_hour_ago_s - age_s, an_hour_ago_s - age_s))
    return tmp_path


def _fill(entry):
    entry.save("array", np.zeros(1000))
    entry.describe(kind="rest")


def _names(folder):
    return {path.name for path in folder.glob("[!.]*")}


def test_of_more_than_the_cache_may_keep_what_was_used_longest_ago_goes(three_entries):
    cache.fetch(three_entries, "mesh-2", lambda entry: pytest.fail("it is there"))
    cache.fetch(three_entries, "rest-4", _fill)
    assert _names(three_entries) == {"rest-1", "mesh-2", "rest-4"}


def test_what_a_start_may_still_have_to_open_stays_even_beyond_the_limit(three_entries):
    for name in ("rest-1", "mesh-2", "rest-3"):
        os.utime(three_entries / name)
    cache.fetch(three_entries, "rest-4", _fill)
    assert len(_names(three_entries)) == 4


def test_what_a_killed_process_left_half_made_goes_with_the_next_that_makes_it(tmp_path):
    left = tmp_path / ".rest-1.x7f_a2"
    left.mkdir()
    (left / "array.npy").write_bytes(b"half of")
    cache.fetch(tmp_path, "rest-1", _fill)
    assert not left.exists()
    assert _names(tmp_path) == {"rest-1"}
