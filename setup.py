"""What a wheel holds beyond the packages: the built page, and the rigs, scenes and devices of `configs`."""

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildWithPage(build_py):
    """Build the page before its files are collected; put `configs` beside the front door afterwards."""

    def run(self) -> None:
        """Collect everything; an editable install builds nothing, `./dev` does that."""
        if self.editable_mode:
            super().run()
            return
        sys.path.insert(0, str(ROOT))
        from trocar.services.visualization.web import build

        if build.main() != 0:
            raise SystemExit("the wheel needs the page, which could not be built")
        super().run()
        shutil.copytree(ROOT / "configs", Path(self.build_lib, "trocar", "configs"), dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithPage})
