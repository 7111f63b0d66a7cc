"""``trocar anatomy``: a segmentation or a surface of a patient becomes a scene that runs."""

from __future__ import annotations

import json
import os
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from trocar.services.anatomy.making import AnatomyRequest, MadeAnatomy, make_anatomy
from trocar.services.anatomy.preview import draw_preview
from trocar.services.anatomy.scene_folder import PICTURE, SCENE, facts, write_folder
from trocar.services.files.cache_directory import cache_directory
from trocar.services.meshes.errors import MeshError
from trocar.services.runtime.errors import ConfigError, MissingPackageError
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import check_duct
from trocar.services.start.off_screen import draw_off_screen


def run_anatomy(
    file: Path,
    out: Path | None,
    label: str | None,
    wall: str | None,
    thickness_mm: float | None,
    surface_is: str,
    unit: str,
    axes: str | None,
    mouth: str | None,
    held: tuple[str, ...],
    names: tuple[str, ...],
    edge_mm: float | None,
    edit: bool,
    port: int,
    as_json: bool,
) -> None:
    """Make the folder and say what is in it.

    Raises ConfigError if the file cannot become a scene, and MissingPackageError if reading it needs a package.
    """
    draw_off_screen(os.environ)
    folder = out or Path(f"{_stem(file)}-scene")
    request = AnatomyRequest(
        label=label, wall=wall, unit=unit, axes=axes, is_middle=surface_is == "middle",
        thickness_m=_metres("--thickness-mm", thickness_mm), edge_m=_metres("--edge-mm", edge_mm),
        mouth=mouth, held=held, names=names,
    )  # fmt: skip
    console = Console(highlight=False, stderr=True)
    is_new = _take_folder(file, folder)
    try:
        made = make_anatomy(file, request, lambda step: console.print(f"{step} ..."))
    except (ModuleNotFoundError, MeshError) as error:
        if is_new:
            folder.rmdir()
        if isinstance(error, ModuleNotFoundError):
            raise MissingPackageError(f"{file}", error.name) from None
        raise ConfigError(str(error)) from None
    _write(made, folder)
    if as_json:
        print(json.dumps({"folder": str(folder), **facts(made)}, indent=1))
    else:
        _tell(made, folder)
    if edit:
        _edit(made, folder, port)


def _take_folder(file: Path, folder: Path) -> bool:
    """Make the folder before the minute of work that fills it; return whether it was not there.

    Raises ConfigError if there is no such file, OSError if the folder cannot be made.
    """
    if not file.is_file():
        raise ConfigError(f"{file}: there is no such file")
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    return is_new


def _write(made: MadeAnatomy, folder: Path) -> None:
    """Write the folder, and check that its scene can be run."""
    write_folder(made, folder)
    draw_preview(made, folder / PICTURE)
    check_duct(load_scene(folder / SCENE), cache_directory())


def _edit(made: MadeAnatomy, folder: Path, port: int) -> None:
    """Serve the page until a person ends it."""
    from trocar.services.anatomy.edit_page import EditPage
    from trocar.services.supervisor.page.page_place import DIST

    if not (DIST / "anatomy.html").is_file():
        raise ConfigError(
            "--edit: the page is not built; `python -m trocar.services.visualization.web.build` builds it"
        )
    page = EditPage(made, lambda each: _write(each, folder), DIST)
    page.serve(port, lambda address: print(f"open {address}\nCtrl-C, or End on the page, ends it", flush=True))


def _metres(option: str, millimetres: float | None) -> float | None:
    if millimetres is not None and not 0.0 < millimetres < 1e3:
        raise ConfigError(f"{option}: must lie between 0 and 1000 mm, is {millimetres:g}")
    return None if millimetres is None else 1e-3 * millimetres


def _stem(file: Path) -> str:
    """Return a file's name without its endings: `duct.seg.nrrd` is `duct`."""
    return file.name.partition(".")[0] or "duct"


def _tell(made: MadeAnatomy, folder: Path) -> None:
    console = Console(highlight=False)
    told = facts(made)
    for line in told["done"]:
        console.print(f"- {escape(line)}", soft_wrap=True)
    for end in told["ends"]:
        place = ", ".join(f"{x:g}" for x in end["at_mm"])
        console.print(
            f"{escape(end['name'])}: {end['is']}, {end['width_mm']:g} mm wide, at {place} mm ({escape(end['named'])})"
        )
    console.print(
        f"wall {told['wall']['thickness_mm']:g} mm ({escape(made.wall.source)}), catheter {made.duct.catheter}"
    )
    console.print(
        f"look at {escape(str(folder / PICTURE))}, then: trocar up --scene {escape(str(folder / SCENE))}",
        soft_wrap=True,
    )
