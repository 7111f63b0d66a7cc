"""Build the site into ``build/site``: ``python -m deploy.site [--check]``; with ``--check`` its links are followed."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from sphinx.cmd.build import build_main

from deploy.site.check import faults
from deploy.site.stage import ROOT, LinkError, repository, stage

SITE, STAGED = ROOT / "build" / "site", ROOT / "build" / "site-pages"


def build(site: Path = SITE, staged: Path = STAGED) -> int:
    """Build the site anew; return an exit code. A warning is an error."""
    try:
        stage(staged)
    except LinkError as error:
        print(f"site: {error}", file=sys.stderr)
        return 1
    shutil.rmtree(site, ignore_errors=True)
    options = ["-b", "html", "-W", "--keep-going", "-q", "-j", "auto", "-d", str(staged.with_name("site-read"))]
    return build_main([*options, "-c", str(Path(__file__).parent), str(staged), str(site)])


def main(arguments: list[str]) -> int:
    """Build, follow the links if that is asked for, and say where the site is."""
    if code := build():
        return code
    found = faults(SITE, repository(), ROOT) if "--check" in arguments else []
    for fault in found:
        print(f"site: {fault}", file=sys.stderr)
    print(SITE / "index.html")
    return min(len(found), 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
