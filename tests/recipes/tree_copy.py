"""A copy of the tree in which a section of docs/how-to/recipes.md is done to the letter: its blocks are the steps.

In a section a block whose first line is ``# path/of/file`` (YAML, Python) is a new file; a ``diff`` block, whose first
line is ``--- path/of/file``, changes one: its unchanged and removed lines stand together in the file exactly once, and
``@@`` parts two places. A ``sh`` block is commands, one a line, run from the root. Others are for the reader.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from markdown_it import MarkdownIt

from tests.kernels.preloaded import Preloaded
from tests.with_us import with_us

#: What a process of a copy imports that is not of the copy; bytecode lies beside its source then.
LIBRARIES = """
import sys
sys.pycache_prefix = None
import msgspec, numba, pydantic, pytest, scipy.linalg, scipy.sparse.linalg, scipy.spatial, yaml, zmq
"""
ROOT = Path(__file__).resolve().parents[2]
RECIPES = Path("docs", "how-to", "recipes.md")
_COPIED = ("services", "studies", "review", "protocol", "trocar", "configs", "docs", "tests", "pyproject.toml")
_TROCAR = "from trocar.services.cli.app import main; main()"
_MODULE = "import runpy, sys; runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
_LEFT_OUT = shutil.ignore_patterns("__pycache__", "node_modules", ".*", "*.mcap", "*.png")


class TreeCopy:
    """The sources, tests, configuration and documents in a folder of their own; `forks` have imported `LIBRARIES`."""

    def __init__(self, root: Path, forks: Preloaded) -> None:
        self.root, self._forks = root, forks
        for name in _COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, root / name, symlinks=True, ignore=_LEFT_OUT)
            else:
                shutil.copy2(ROOT / name, root / name)
            take_bytecode(ROOT, root, name)
        self._pristine = self._stamps()

    def restore(self) -> None:
        """Undo all that was written, changed or removed since the copy was made; compiled bytecode stays."""
        stamps = self._stamps()
        for path in stamps.keys() - self._pristine.keys():
            path.unlink()
        for path, stamp in self._pristine.items():
            if stamps.get(path) != stamp:
                path.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / path.relative_to(self.root), path)
        for folder, _, _ in os.walk(self.root, topdown=False):
            with suppress(OSError):  # what is not empty stays
                Path(folder).rmdir()

    def _stamps(self) -> dict[Path, tuple[int, int]]:
        """Return time and size of every file, but for bytecode."""
        stamps = {}
        for folder, folders, files in os.walk(self.root):
            folders[:] = [name for name in folders if name != "__pycache__"]
            for path in (Path(folder) / name for name in files):
                if path.is_symlink() or not path.is_socket():
                    stat = path.lstat()
                    stamps[path] = stat.st_mtime_ns, stat.st_size
                else:
                    path.unlink()
        return stamps

    def follow(self, section: str) -> None:
        """Do every step of the section ``## section`` of this copy's docs/how-to/recipes.md, from top to bottom.

        What it has written and changed passes the lint that the whole tree has to pass.
        """
        touched: set[str] = set()
        for language, text in _blocks((self.root / RECIPES).read_text(encoding="utf-8"), section):
            if language == "sh":
                for line in text.splitlines():
                    self.command(line)
            elif language == "diff":
                touched.add(self._change(text))
            elif text.startswith("# ") and "/" in text.splitlines()[0]:
                touched.add(self._create(text))
        sources = sorted(path for path in touched if path.endswith(".py"))
        for check in (("check",), ("format", "--check")) if sources else ():
            self.run("ruff", *check, "--no-cache", *sources)

    def command(self, line: str) -> str:
        """Do one line of a ``sh`` block, and return what it prints where it is not to be written to a file.

        What is Python begins as a fork, with its libraries imported, which is half of what such a line takes.
        """
        words, _, file = line.partition(" > ")
        match shlex.split(words):
            case ["trocar", *arguments]:
                said = self.python(_TROCAR, *arguments)
            case ["python", "-m", *arguments]:
                said = self.python(_MODULE, *arguments)
            case _:
                return self.run("bash", "-ec", line)
        if file:
            (self.root / file).write_text(said, encoding="utf-8")
        return said

    def run(self, *command: str, timeout_s: float = 500.0) -> str:
        """Run a command in the copy, with this interpreter's tools first, and return what it prints.

        An exit code that is not zero fails the test with everything that the command said.
        """
        done = subprocess.run(
            command,
            cwd=self.root,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        said = f"{done.stdout}\n{done.stderr}"
        assert done.returncode == 0, f"{' '.join(command)} ended with {done.returncode}:\n{said}"
        return done.stdout

    def python(self, code: str, *arguments: str, expects: tuple[int, ...] = (0,)) -> str:
        """Run `code` with the copy's packages, and return what it prints."""
        done = self._forks.start(code, arguments, self.root, self._environment).wait()
        assert done.returncode in expects, f"ended with {done.returncode}:\n{done.stdout}\n{done.stderr}\n{code}"
        return done.stdout

    @contextmanager
    def start(self, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
        """Run Python in the background, and ask it to end at the end."""
        process = subprocess.Popen(with_us([sys.executable, *arguments]), cwd=self.root, env=self._environment)
        try:
            yield process
        finally:
            process.terminate()
            process.wait(120)

    @property
    def _environment(self) -> dict[str, str]:
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        # Bytecode lies in the copy, as it goes with it.
        bytecode = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": ""}
        modules = os.pathsep.join(filter(None, [str(self.root), os.environ.get("PYTHONPATH")]))
        return {**os.environ, "PATH": path, "PYTHONPATH": modules, **bytecode}

    def pytest(self, *arguments: str, expects: tuple[int, ...] = (0,)) -> str:
        """Run tests of the copy, and return what pytest prints."""
        code = "import sys, pytest; sys.exit(pytest.main(sys.argv[1:]))"
        return self.python(code, "-q", "-p", "no:cacheprovider", *arguments, expects=expects)

    def failed_tests(self, suite: str, *arguments: str) -> dict[str, set[str]]:
        """Return by parameter which tests of a suite in the copy fail or cannot be set up: none where all pass."""
        report = self.root / "report.xml"
        self.pytest("--tb=no", f"--junitxml={report}", suite, *arguments, expects=(0, 1))
        failed: dict[str, set[str]] = {}
        for case in ElementTree.parse(report).iter("testcase"):
            named = re.fullmatch(r"(\w+)\[(?:\d-)?(\w+)(?:-[^]]*)?\]", case.get("name", ""))
            assert named is not None, case.get("name")
            test, parameter = named.groups()
            seen = failed.setdefault(parameter, set())
            if any(child.tag in ("failure", "error") for child in case):
                seen.add(test)
        return failed

    def _create(self, text: str) -> str:
        file = self.root / text.splitlines()[0].removeprefix("# ")
        assert not file.exists(), f"the recipe makes {file.name}, which there is already"
        assert file.parent.is_dir(), f"the recipe makes a file in {file.parent}, which there is not"
        file.write_text(text.split("\n", 1)[1].lstrip("\n"), encoding="utf-8")
        return str(file.relative_to(self.root))

    def _change(self, text: str) -> str:
        first, hunks = text.split("\n", 1)
        file = self.root / first.removeprefix("--- ")
        content = file.read_text(encoding="utf-8")
        for hunk in hunks.rstrip("\n").split("\n@@\n"):
            lines = [line or " " for line in hunk.splitlines()]
            assert {line[0] for line in lines} <= set(" +-"), f"not a diff of {file.name}:\n{hunk}"
            before = "".join(f"{line[1:]}\n" for line in lines if line[0] != "+")
            after = "".join(f"{line[1:]}\n" for line in lines if line[0] != "-")
            found = f"\n{content}".count(f"\n{before}")
            assert found == 1, f"{file.name} has these lines {found} times:\n{before}"
            content = f"\n{content}".replace(f"\n{before}", f"\n{after}", 1)[1:]
        file.write_text(content, encoding="utf-8")
        return str(file.relative_to(self.root))


def take_bytecode(tree: Path, copy: Path, name: str) -> None:
    """Give a folder of a copy what Python has compiled of the tree, or each copy would compile all that it imports.

    By the times of its sources, which a copy has, Python knows what is theirs; what a recipe changes is compiled anew.
    """
    kept = tree if sys.pycache_prefix is None else Path(sys.pycache_prefix, *tree.parts[1:])
    for path in (kept / name).rglob("*.pyc"):
        folder = copy / path.parent.relative_to(kept)
        if folder.name != "__pycache__":
            folder /= "__pycache__"
        if folder.parent.is_dir():
            folder.mkdir(exist_ok=True)
            shutil.copy2(path, folder)


def _blocks(document: str, section: str) -> list[tuple[str, str]]:
    """Return language and text of the fenced blocks in a section."""
    tokens = MarkdownIt().parse(document)
    headings = [i for i, token in enumerate(tokens) if token.type == "heading_open" and token.tag == "h2"]
    for begin, end in zip(headings, [*headings[1:], len(tokens)], strict=True):
        if tokens[begin + 1].content == section:
            return [(t.info.strip(), t.content) for t in tokens[begin:end] if t.type == "fence"]
    raise AssertionError(f"docs/how-to/recipes.md has no section {section!r}")
