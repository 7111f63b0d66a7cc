"""What a wheel holds beyond the packages: the built page, `configs`, and kernels where a release has compiled them."""

import shutil
import sys
from pathlib import Path
from platform import machine

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

ROOT = Path(__file__).resolve().parent
#: Kernels for this Python, made by `./dev wheel`; another Python's serve nobody here.
KERNELS = sorted((ROOT / "build" / "kernels").glob(f"*-{sys.implementation.cache_tag}-*.tar.zst"))


class BuildWithPage(build_py):
    """Build the page before its files are collected; put `configs` and kernels beside the front door afterwards."""

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
        front = Path(self.build_lib, "trocar")
        shutil.copytree(ROOT / "configs", front / "configs", dirs_exist_ok=True)
        shutil.rmtree(front / "kernels", ignore_errors=True)
        for archive in KERNELS:
            (front / "kernels").mkdir(exist_ok=True)
            shutil.copy2(archive, front / "kernels")


class WheelOfThisPython(bdist_wheel):
    """A wheel with kernels is for one Python and one architecture; without them it is for all."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the tag; kernels call nothing of the C library that its oldest supported version lacks."""
        python, abi, platform = super().get_tag()
        if not KERNELS:
            return python, abi, platform
        return f"cp{sys.version_info.major}{sys.version_info.minor}", "none", f"manylinux_2_17_{machine()}"


class SourcesWithPage(sdist):
    """Sources that build the same wheel by themselves, kernels aside: with the page, its own sources, and `configs`."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Collect everything; setuptools finds none of what lies behind a link and is not Python."""
        sys.path.insert(0, str(ROOT))
        from trocar.services.visualization.web import build

        if build.main() != 0:
            raise SystemExit("the sources hold the page, which could not be built")
        super().make_release_tree(base_dir, files)
        left_out = shutil.ignore_patterns("node_modules", "__pycache__")
        web = Path(base_dir, "trocar", *build.WEB.relative_to(ROOT).parts)
        shutil.copytree(build.WEB, web, dirs_exist_ok=True, ignore=left_out)
        shutil.copytree(ROOT / "configs", Path(base_dir, "configs"), dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithPage, "bdist_wheel": WheelOfThisPython, "sdist": SourcesWithPage})
