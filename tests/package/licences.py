"""Licences of what Trocar depends on: ``python -m tests.package.licences`` lists those of what is installed."""

from __future__ import annotations

import re
from importlib.metadata import Distribution, distributions, version
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: What may come with Trocar, or be imported by it unchanged: permissive, or weak copyleft of whole files or libraries.
ALLOWED = (
    *("MIT", "MIT-0", "MIT-CMU", "BSD", "BSD-2-Clause", "BSD-3-Clause", "0BSD", "ISC", "Zlib", "Apache", "Apache-2.0"),
    *("PSF-2.0", "MPL-2.0", "LGPL-3.0-only", "LGPL-3.0-or-later"),
    *("CC0-1.0", "Apache-2.0 WITH LLVM-exception", "DFSG approved"),
)
#: What says nothing that a program can read, or something else; only who develops Trocar installs these.
BY_HAND = {
    "docutils": "public domain or BSD, but for a tool for Emacs; the site is made with it",
    "ipctk": "MIT; tests compare distances with it",
    "openseespy": "free for research, education and internal use, not for redistribution; tests compare shells with it",
    "openseespylinux": "as openseespy, whose compiled part it is",
}
_SAME = {
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
_LEFT_OUT = re.compile(r" (?:Software )?License(?= AND| \(|$)| \(ISCL\)")


def pinned(lock: str) -> set[str]:
    """Return the packages that a lock file names, in their normal form."""
    text = (ROOT / f"requirements-{lock}.lock").read_text(encoding="utf-8")
    return {normal(name) for name in re.findall(r"^([\w.-]+)(?:\[[\w,]+\])?==", text, re.MULTILINE)}


def normal(name: str) -> str:
    """Return the normal form of a package's name."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(distribution: Distribution) -> str:
    """Return what a package says of its licence: an expression, else its classifiers, else a line."""
    said = distribution.metadata
    classes = [c.split(" :: ")[-1] for c in said.get_all("Classifier", []) if c.startswith("License ::")]
    text = said.get("License-Expression") or " AND ".join(classes) or (said.get("License") or "").split("\n")[0]
    for word, other in _SAME.items():
        text = text.replace(word, other)
    return _LEFT_OUT.sub("", text).replace("3-Clause BSD", "BSD-3-Clause")


def is_allowed(text: str) -> bool:
    """Return whether all parts of an expression are allowed, of alternatives one."""
    return any(all(part.strip(" ()") in ALLOWED for part in each.split(" AND ")) for each in text.split(" OR "))


def inventory() -> dict[str, str]:
    """Return the licence of each installed package that a lock file names."""
    wanted = pinned("run") | pinned("dev")
    found = {normal(each.metadata["Name"]): licence(each) for each in distributions()}
    return {name: BY_HAND.get(name, found[name]) for name in sorted(wanted & found.keys())}


def main() -> None:
    """Print the inventory as a table."""
    shipped = pinned("run")
    print("| package | version | licence | comes with |\n| --- | --- | --- | --- |")
    for name, text in inventory().items():
        print(f"| {name} | {version(name)} | {text} | {'a rig' if name in shipped else 'development'} |")


if __name__ == "__main__":
    main()
