"""``trocar scenes``: the scenes that can be named, each with the sentence that its file begins with."""

from __future__ import annotations

import json
from itertools import takewhile
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.messages.first_sentence import first_sentence
from trocar.services.runtime.config import config


def run_scenes(as_json: bool) -> None:
    """Print all scenes of configs/scenes."""
    folder = config.config_directory() / "scenes"
    said = {path.stem: described(path) for path in sorted(folder.glob("*.yaml"))}
    if as_json:
        print(json.dumps({"scenes": said}, indent=1))
        return
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, sentence in said.items():
        table.add_row(escape(name), escape(sentence))
    console = Console(highlight=False)
    console.print(table)
    console.print("`trocar up --scene NAME` runs one, `trocar config show --scene NAME` prints all that is in it.")


def described(path: Path) -> str:
    """Return the first sentence of the comment that a file begins with, empty without one."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return first_sentence("\n".join(line[1:].strip() for line in takewhile(lambda line: line.startswith("#"), lines)))
