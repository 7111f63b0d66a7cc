"""Pages of the API: one for what is public, one for each part of the mechanics, made from docstrings.

Docstrings of the project are plain text in Google's layout: a name between backticks is code, and so is an indented
paragraph. `plain_to_rst` says that in Sphinx's own language.
"""

from __future__ import annotations

import re
from importlib import import_module
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_PUBLIC = {
    "trocar": ("The front door: `trocar`", ["trocar"]),
    "envs": (
        "Environments: `trocar.envs`",
        ["trocar.envs", "trocar.envs.expert", "trocar.envs.frames", "trocar.envs.cloning", "trocar.envs.recording"],
    ),
}
_MECHANICS = "trocar.services.mechanics"
_SECTION = re.compile(r"(Args|Arguments|Attributes|Raises|Returns|Yields|Note|Example|Examples):$")
_KEPT = re.compile(r"(?::\w+:)?(?P<code>``.+?``|`[^`]+`)|(?<![\w*])\*(?=\S)[^*`\n]+(?<=\S)\*(?![\w*])", re.DOTALL)
"""Code, which may have the name of a kind of text before it, and words with stress."""
_MEANS = re.compile(r"[\\*|]|(?<=\w)_(?!\w)")
"""What means something in reStructuredText, and nothing in plain text."""


def pages() -> dict[str, str]:
    """Return the pages by their file's name."""
    made = {f"api/{name}.rst": _public_page(title, modules) for name, (title, modules) in _PUBLIC.items()}
    parts = sorted(_parts())
    for part in parts:
        name = part.removeprefix(f"{_MECHANICS}.")
        made[f"api/mechanics/{name}.rst"] = _page(f"Mechanics: `{name}`", _modules(part), "   :ignore-module-all:\n")
    return made | {"api/index.rst": _index([part.removeprefix(f"{_MECHANICS}.") for part in parts])}


def _index(parts: list[str]) -> str:
    listed = "".join(f"   mechanics/{name}\n" for name in parts)
    public = "".join(f"   {name}\n" for name in _PUBLIC)
    return (
        f"{_heading('API reference', '=')}\n"
        "Names of ``trocar`` and ``trocar.envs`` are stable by the rules of :doc:`/project/contributing`. The mechanics"
        " are told of for readers of the code, and change with any release.\n\n"
        f".. toctree::\n   :caption: Public\n   :titlesonly:\n\n{public}\n"
        f".. toctree::\n   :caption: Mechanics\n   :titlesonly:\n\n{listed}"
    )


def _parts() -> list[str]:
    folder = ROOT / "services" / "mechanics"
    paths = [path for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    return [f"{_MECHANICS}.{path.stem}" for path in paths if not path.stem.startswith("__")]


def _modules(part: str) -> list[str]:
    folder = ROOT.joinpath(*part.removeprefix("trocar.").split("."))
    if not folder.is_dir():
        return [part]
    files = sorted(folder.rglob("*.py"), key=lambda path: (path.parent, path.name != "__init__.py", path.name))
    dotted = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]
    return [f"trocar.{name.removesuffix('.__init__')}" for name in dotted]


def _public_page(title: str, modules: list[str]) -> str:
    """Return a page that begins with the names that it tells of."""
    names = [f":py:obj:`~{modules[0]}.{name}`" for name in import_module(modules[0]).__all__]
    first, _, rest = _page(title, modules, "").partition("\n\n")
    return f"{first}\n\n{', '.join(names)}\n\n{rest}"


def _page(title: str, modules: list[str], option: str) -> str:
    """Return a page of modules, each under a heading of its own where there are several."""
    parts = [_heading(title.replace("`", "``"), "=")]
    for module in modules:
        parts += [_heading(f"``{module.removeprefix(f'{_MECHANICS}.')}``", "-")] if len(modules) > 1 else []
        parts += [f".. automodule:: {module}\n   :members:\n{option}"]
    return "\n".join(parts)


def _heading(title: str, line: str) -> str:
    return f"{title}\n{line * len(title)}\n"


def plain_to_rst(text: str) -> str:
    """Return a docstring in reStructuredText, sections in Google's layout left as they are."""
    blocks = _blocks(text.splitlines())
    return "\n".join(_as_code(block) if is_code else _escaped(block) for is_code, block in blocks)


def _blocks(lines: list[str]) -> list[tuple[bool, str]]:
    """Return runs of lines, each with whether it is an indented paragraph outside a section."""
    marks: list[bool] = []
    in_section, before = False, ""
    for line in lines:
        indented = line.startswith("    ")
        if line.strip() and not line.startswith(" "):
            in_section = bool(_SECTION.match(line)) or line.startswith(("- ", "* "))
        in_code = bool(marks) and marks[-1]
        is_code = indented and not in_section and (in_code or not before.strip())
        marks.append(is_code or (in_code and not line.strip()))
        before = line
    cuts = [0, *(k + 1 for k, (one, other) in enumerate(pairwise(marks)) if one != other), len(lines)]
    return [(marks[a], "\n".join(lines[a:b])) for a, b in pairwise(cuts) if a < b]


def _as_code(block: str) -> str:
    return f"::\n\n{block}\n"


def _escaped(block: str) -> str:
    parts, at = [], 0
    for kept in _KEPT.finditer(block):
        code = kept["code"]
        parts += [_MEANS.sub(r"\\\g<0>", block[at : kept.start()]), f"``{code.strip('`')}``" if code else kept.group()]
        at = kept.end()
    return "".join([*parts, _MEANS.sub(r"\\\g<0>", block[at:])])
