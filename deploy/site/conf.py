"""What Sphinx is told of the site."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from deploy.site.api import plain_to_rst
from deploy.site.stage import repository

_project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
project = "Trocar"
author = "The maintainers of Trocar"
project_copyright = "The maintainers of Trocar. Apache License 2.0"
release = version = _project["version"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 6
highlight_language = "none"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {
    f"{kind}Array": f"{kind}Array" for kind in ("Any", "Float", "Float32", "Int", "Long", "Byte", "Bool")
}
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
# Entries for each object in every page's side would take most of the time of a build.
toc_object_entries = False
# A type that is public and also told of where it is defined has two places, either of which will do.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_title = f"Trocar {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "footer_icons": [{"name": "Repository", "url": repository(), "html": "repository", "class": ""}],
    "navigation_with_keys": True,
}
pygments_style, pygments_dark_style = "tango", "github-dark"


_of_values: dict[str, list[str]] = {}


def _convert(_app: Any, what: str, name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = plain_to_rst("\n".join(lines)).splitlines()
    if what in ("data", "attribute"):
        _of_values[name] = [*lines, ""]


def _keep_sentence(_app: Any, _what: str, name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Take the text of a value as it was: what stands before a colon in it is no type."""
    if name in _of_values:
        lines[:] = _of_values.pop(name)


def setup(app: Any) -> None:
    """Read docstrings as plain text, before their sections are read."""
    app.connect("autodoc-process-docstring", _convert, priority=100)
    app.connect("autodoc-process-docstring", _keep_sentence, priority=900)
