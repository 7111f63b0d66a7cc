"""Make a release, and publish nothing: ``./dev release VERSION`` (``python deploy/release.py VERSION``).

Writes the version where it stands, makes samples, wheel, sources, image and site, runs all tests, checks what was made,
commits and tags. Up to the commit `git restore .` undoes it.
"""

from __future__ import annotations

import argparse
import datetime
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from email.parser import BytesParser
from pathlib import Path, PurePosixPath

from packaging.version import InvalidVersion, Version

ROOT = Path(__file__).resolve().parents[1]
BRANCH = "main"
_UNRELEASED = "## Unreleased"
_STRANGERS = ("services.py", "studies.py", "review.py", "protocol/__init__.py")
"""Names that a user's own folder may have."""


class ReleaseError(Exception):
    """The release cannot be made; the message says why in a sentence."""


@dataclass(frozen=True)
class Plan:
    """What is to be released."""

    version: str
    date: datetime.date
    tests_have_passed: bool = False
    samples_are_new: bool = False


def say(text: str) -> None:
    """Print a line between those of the tools."""
    print(f"release: {text}", flush=True)


def git(*words: str, root: Path = ROOT) -> str:
    """Return what git says, without the line's end."""
    done = subprocess.run(["git", "-C", str(root), *words], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def run(*words: str | Path, cwd: Path = ROOT, **environment: str) -> None:
    """Run a tool with its own output.

    Raises ReleaseError if it fails.
    """
    command = [str(word) for word in words]
    if subprocess.run(command, cwd=cwd, env={**os.environ, **environment}, check=False).returncode:
        raise ReleaseError(f"{' '.join(command)} failed; `git restore .` undoes what the release has written")


def refuse(version: str, root: Path = ROOT) -> None:
    """Look whether a version can be released from this tree.

    Raises ReleaseError: one sentence, if it cannot.
    """
    try:
        new = Version(version)
    except InvalidVersion:
        raise ReleaseError(f"{version!r} is no version, such as 1.2.0") from None
    if str(new) != version or new.local:
        raise ReleaseError(f"{version!r} is written {new.public} in a release")
    old = present_version(root)
    if new <= Version(old):
        raise ReleaseError(f"{version} is not newer than {old}, which pyproject.toml has")
    if git("tag", "--list", f"v{version}", root=root):
        raise ReleaseError(f"the tag v{version} exists already")
    if (branch := git("rev-parse", "--abbrev-ref", "HEAD", root=root)) != BRANCH:
        raise ReleaseError(f"releases are made on {BRANCH}, and this is {branch}")
    if changed := git("status", "--porcelain", root=root).splitlines():
        raise ReleaseError(f"the tree has changes that are not committed, the first in {changed[0].split()[-1]}")
    if not entries(root):
        raise ReleaseError(f'CHANGELOG.md says nothing under "{_UNRELEASED}"')


def present_version(root: Path = ROOT) -> str:
    """Return the version in pyproject.toml."""
    return str(tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])


def entries(root: Path = ROOT) -> list[str]:
    """Return the lines of the changelog on what is not released yet."""
    _, _, after = (root / "CHANGELOG.md").read_text(encoding="utf-8").partition(f"\n{_UNRELEASED}\n")
    return [line for line in after.partition("\n## ")[0].splitlines() if line.strip()]


def write_versions(plan: Plan, root: Path = ROOT) -> None:
    """Write the version into pyproject.toml, CITATION.cff with the day, and the changelog's heading."""
    _replace(root / "pyproject.toml", r'^version = ".*"$', f'version = "{plan.version}"')
    _replace(root / "CITATION.cff", r"^version: .*\n(?:date-released: .*\n)?", _citation(plan))
    _replace(root / "CHANGELOG.md", rf"^{_UNRELEASED}$", f"## {plan.version}\n\nReleased on {plan.date}.")


def _citation(plan: Plan) -> str:
    return f"version: {plan.version}\ndate-released: {plan.date}\n"


def _replace(path: Path, pattern: str, text: str) -> None:
    old = path.read_text(encoding="utf-8")
    new, count = re.subn(pattern, lambda _: text, old, count=1, flags=re.MULTILINE)
    if not count:
        raise ReleaseError(f"{path.name} has no line {pattern!r}")
    path.write_text(new, encoding="utf-8")


def make_samples() -> None:
    """Make the sample recordings anew, by the command as it is installed with the new version."""
    run("./dev", "shell", "-c", "python -m benchmarks.make_samples", SHELL="/bin/sh")


def make_sources() -> Path:
    """Return the sources' archive, made anew."""
    for old in (ROOT / "dist").glob("trocar-*.tar.gz"):
        old.unlink()
    code = "from setuptools.build_meta import build_sdist; build_sdist('dist', {'--global-option': ['--quiet']})"
    run(sys.executable, "-c", f"import sys; sys.stdout = sys.stderr; {code}")
    return _only("trocar-*.tar.gz")


def make_wheel() -> Path:
    """Return the wheel with kernels for this Python, made anew."""
    run("./dev", "wheel")
    return _only("trocar-*.whl")


def _only(pattern: str) -> Path:
    found = sorted((ROOT / "dist").glob(pattern))
    if len(found) != 1:
        raise ReleaseError(f"dist holds {len(found)} files {pattern}, and should hold one")
    return found[0]


def check_metadata(wheel: Path, sources: Path, version: str) -> None:
    """Check the version that wheel and sources say they have.

    Raises ReleaseError if one differs.
    """
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (each for each in archive.namelist() if each.endswith(".dist-info/METADATA"))
        of_wheel = BytesParser().parsebytes(archive.read(name))["Version"]
    with tarfile.open(sources) as files:
        (said,) = (each for each in files.getmembers() if PurePosixPath(each.name).match("trocar-*/PKG-INFO"))
        content = files.extractfile(said)
        of_sources = BytesParser().parsebytes(content.read() if content else b"")["Version"]
    if not of_wheel == of_sources == version:
        raise ReleaseError(f"the wheel has version {of_wheel}, the sources {of_sources}, not {version}")


def check_sources(sources: Path, wheel: Path) -> None:
    """Check that the sources build what the wheel holds, but for kernels.

    Raises ReleaseError if they do not.
    """
    with tempfile.TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
        run(*pip, "--wheel-dir", folder, sources, cwd=Path(folder), PYTHONPATH="")
        (built,) = Path(folder).glob("*.whl")
        differ = {name for name in _names(built) ^ _names(wheel) if not name.endswith(".tar.zst")}
    if differ:
        raise ReleaseError(f"wheel and sources differ in {len(differ)} files, one of them {min(differ)}")


def _names(wheel: Path) -> set[str]:
    return set(zipfile.ZipFile(wheel).namelist())


def check_wheel(wheel: Path, version: str) -> None:
    """Check that the wheel works alone: in an empty environment, beside a stranger's modules of the same names.

    Raises ReleaseError if it does not.
    """
    code = f"""
import importlib.metadata, pathlib, trocar
assert importlib.metadata.version("trocar") == {version!r}
assert "site-packages" in trocar.__file__, trocar.__file__
trocar.load_scene("insertion")
"""
    with tempfile.TemporaryDirectory() as folder:
        python, user = Path(folder, "venv", "bin", "python"), Path(folder, "user")
        run(sys.executable, "-m", "venv", python.parents[1])
        run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
        for name in _STRANGERS:
            (user / name).parent.mkdir(parents=True, exist_ok=True)
            (user / name).write_text('raise ImportError("a module of somebody else was imported")\n', encoding="utf-8")
        run(python, "-c", code, cwd=user, PYTHONPATH=str(user))
        run(python.with_name("trocar"), "scenarios", cwd=user, PYTHONPATH=str(user))


def make_image(version: str) -> str:
    """Build the image where there is a container engine, and look at its rig; return a sentence."""
    docker = shutil.which("docker")
    if docker is None or subprocess.run([docker, "info"], capture_output=True, check=False).returncode:
        return "no image was made, as no container engine runs here"
    run("deploy/check-compose")
    run(docker, "tag", "trocar", f"trocar:{version}")
    return f"the image is trocar:{version}"


def commit_and_tag(plan: Plan) -> None:
    """Commit what the release has written, and tag that with what the changelog says."""
    notes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").partition(f"\n## {plan.version}\n")[2]
    text = notes.partition("\n## ")[0].strip()
    git("add", "--update")
    git(
        "commit", "--message", f"Release {plan.version}", "--message", "Versions, and samples that this version writes."
    )
    git(
        "tag", "--annotate", f"v{plan.version}", "--cleanup=whitespace", "--message", f"Trocar {plan.version}\n\n{text}"
    )


def steps(plan: Plan) -> list[tuple[str, Callable[[], object]]]:
    """Return what comes before the artefacts, each with what it is called."""
    listed: list[tuple[str, Callable[[], object]]] = [("versions", lambda: write_versions(plan))]
    if not plan.samples_are_new:
        listed.append(("samples", make_samples))
    if not plan.tests_have_passed:
        listed.append(("tests", lambda: run("./dev", "test", "--long")))
    return listed


def release(plan: Plan) -> None:
    """Make and check everything, commit and tag.

    Raises ReleaseError: one sentence, if anything is not as it must be.
    """
    refuse(plan.version)
    for name, step in steps(plan):
        say(name)
        step()
    say("wheel and sources")
    wheel, sources = make_wheel(), make_sources()
    check_metadata(wheel, sources, plan.version)
    check_sources(sources, wheel)
    say("the wheel in an empty environment")
    check_wheel(wheel, plan.version)
    say("image")
    image = make_image(plan.version)
    say("site")
    run(sys.executable, "-m", "deploy.site", "--check")
    commit_and_tag(plan)
    for line in _told(plan, wheel, sources, image):
        say(line)


def _told(plan: Plan, wheel: Path, sources: Path, image: str) -> list[str]:
    """Return what was made, what was left out, and how it is published."""
    left_out = [
        *(["tests were not run, as asked"] if plan.tests_have_passed else []),
        *(["samples were not made anew, as asked"] if plan.samples_are_new else []),
        *(["project.urls in pyproject.toml name no real repository yet"] if _has_no_repository() else []),
    ]
    made = [f"{path.relative_to(ROOT)} ({path.stat().st_size / 1e6:.1f} MB)" for path in (wheel, sources)]
    return [
        *left_out,
        f"made {', '.join(made)} and build/site; {image}",
        f"nothing is published; `git push origin {BRANCH} v{plan.version}` lets the workflows do that",
    ]


def _has_no_repository() -> bool:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return any(".example/" in f"{url}/" for url in project["urls"].values())


def main(arguments: list[str]) -> int:
    """Release what the command line says."""
    parser = argparse.ArgumentParser(prog="./dev release", description="Make a release, and publish nothing.")
    parser.add_argument("version", help="such as 1.2.0")
    parser.add_argument("--tests-have-passed", action="store_true", help="do not run them again")
    parser.add_argument("--samples-are-new", action="store_true", help="keep the sample recordings as they are")
    words = parser.parse_args(arguments)
    today = datetime.datetime.now(datetime.UTC).date()
    try:
        release(Plan(words.version, today, words.tests_have_passed, words.samples_are_new))
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
