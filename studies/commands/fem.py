"""``trocar fem``: anyone's own shell case from a YAML file, solved, shown, and written for other tools."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.cli import targets
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError, MissingPackageError
from trocar.studies.commands.progress_bar import progress_line
from trocar.studies.fem.calculix import apart, check_case, compare, solve_by_calculix, write_deck
from trocar.studies.fem.case import FemCase
from trocar.studies.fem.output import save_vtu, to_json
from trocar.studies.fem.run import FemResult, solve_case
from trocar.studies.progress import Tell


class Stages:
    """Tells of one stage of the solution after the other."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._stage, self._done, self._total = "", 0, 0

    def __call__(self, stage: str, steps: int) -> None:
        """Begin a named stage, or advance the present one."""
        if stage:
            self._stage, self._done, self._total = stage, 0, steps
        else:
            self._done = min(self._done + steps, self._total)
        self._tell(self._stage, self._done, self._total)


@dataclass(frozen=True, slots=True)
class Written:
    """Where to write numbers for programs, fields for ParaView, and the case for CalculiX."""

    json: Path | None = None
    vtu: Path | None = None
    inp: Path | None = None

    def named(self) -> list[tuple[str, Path]]:
        """Return each that is given, with its option."""
        pairs = (("--json", self.json), ("--vtu", self.vtu), ("--inp", self.inp))
        return [(option, path) for option, path in pairs if path is not None]


def fem_command(
    file: Path,
    json_file: Path | None = None,
    vtu_file: Path | None = None,
    inp_file: Path | None = None,
    *,
    by_calculix: bool = False,
) -> None:
    """Solve the case in a file and print what it gives.

    Raises ConfigError: one sentence that names the file and the key or place. Raises UserError: what was found is
    printed, but cannot be written.

    Args:
        file: YAML, see `trocar.studies.fem.case.FemCase` and the examples in ``configs/fem``.
        json_file, vtu_file, inp_file: Where to write numbers for programs, fields for ParaView, the case for CalculiX.
        by_calculix: Whether CalculiX solves the case, too, and both solutions are compared.
    """
    written = Written(json_file, vtu_file, inp_file)
    for option, path in written.named():
        targets.look_at_file(option, path)
    case, _ = config.load(FemCase, file)
    _keep_apart(file, case, written)
    if inp_file is not None or by_calculix:
        check_case(case)
    try:
        result = _solve_with_progress(case, file)
    except ModuleNotFoundError as error:
        raise MissingPackageError(f"{file}: this", error.name) from error
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from error
    _print(result, Console(soft_wrap=True))
    if json_file is not None:
        targets.write_text("--json", json_file, json.dumps(to_json(result), indent=1))
    if vtu_file is not None:
        with targets.writing("--vtu", vtu_file):
            save_vtu(result, vtu_file)
    if inp_file is not None:
        with targets.writing("--inp", inp_file):
            write_deck(result, inp_file)
    if by_calculix:
        _print_comparison(result, Console(soft_wrap=True))


def _print_comparison(result: FemResult, console: Console) -> None:
    other = solve_by_calculix(result)
    table = Table()
    for title in ("", "here", "CalculiX, S6", "here more by"):
        table.add_column(title, overflow="fold")
    for name, ours, theirs, more in compare(result, other):
        table.add_row(escape(name), f"{ours:.6g}", f"{theirs:.6g}", "" if more is None else f"{100.0 * more:.2f} %")
    console.print(table)
    share = apart(result, other)
    if share is not None:
        console.print(f"all displacements differ by {100.0 * share:.2f} % of ours, root mean square")


def _keep_apart(file: Path, case: FemCase, written: Written) -> None:
    """Refuse to write over what is read, or twice to one place."""
    surface = case.mesh.duct_file or case.mesh.surface_file
    taken = {file: "is the case itself"}
    if surface is not None:
        taken[file.parent / surface.path] = "is the case's mesh"
    for option, path in written.named():
        for other, what in taken.items():
            if (path.is_file() and other.exists() and path.samefile(other)) or path.absolute() == other.absolute():
                raise ConfigError(f"{option} {path}: {what}")
        if path.is_file() or not path.exists():  # both may go to one device
            taken[path] = f"is what {option} writes"


def _solve_with_progress(case: FemCase, file: Path) -> FemResult:
    with progress_line() as tell:
        return solve_case(case, file.parent, Stages(tell))


def _print(result: FemResult, console: Console) -> None:
    data = to_json(result)
    mesh = data["mesh"]
    for action in mesh["actions"]:
        console.print(f"mesh: {action}", markup=False)
    for caution in data["cautions"]:
        console.print(f"caution: {caution}", markup=False)
    console.print(f"{mesh['vertices']} vertices, {mesh['triangles']} triangles, {mesh['free_dofs']} free dofs")
    if "static" in data:
        _print_static(data["static"], console)
    if "path" in data:
        _print_path(data["path"]["points"], console)
    if "frequency_hz" in data:
        table = _table("mode", "Hz")
        for k, frequency in enumerate(data["frequency_hz"], 1):
            table.add_row(str(k), f"{frequency:.6g}")
        console.print(table)
    if "load_factor" in data:
        table = _table("buckling", "multiple of the loads")
        for k, factor in enumerate(data["load_factor"], 1):
            table.add_row(str(k), f"{factor:.6g}")
        console.print(table)


def _table(*titles: str) -> Table:
    """In a narrow terminal a number goes on in the next line: cut off it would be another, without its exponent."""
    table = Table()
    for title in titles:
        table.add_column(title, overflow="fold")
    return table


def _print_path(points: list[dict[str, Any]], console: Console) -> None:
    """One row a point: load, what it took, and how far the largest and every probed place moved."""
    probes = list(points[-1]["probes"])
    table = _table("load", "iterations", "largest displacement m", *(escape(f"{name} m") for name in probes))
    for point in points:
        moved = [" ".join(f"{x:.5g}" for x in point["probes"][name]) for name in probes]
        table.add_row(
            f"{point['part']:.4g}", str(point["iterations"]), f"{point['largest_displacement_m']:.6g}", *moved
        )
    console.print(table)
    last = points[-1]
    force = " ".join(f"{x:.6g}" for x in last["reaction_force_n"])
    console.print(f"at the full load: reaction force {force} N, residual {last['residual']:.1e}")
    _print_supports(last["support_force_n"], console)


def _print_supports(forces_n: list[list[float]], console: Console) -> None:
    for k, force_n in enumerate(forces_n):
        console.print(f"supports.{k}: force {' '.join(f'{x:.6g}' for x in force_n)} N", markup=False)


def _print_static(static: dict[str, Any], console: Console) -> None:
    table = _table("static solution", "x", "y", "z")
    rows = {"reaction force N": static["reaction_force_n"]}
    rows["reaction moment about origin N m"] = static["reaction_moment_about_origin_n_m"]
    rows |= {f"displacement at {name} m": value for name, value in static["probes"].items()}
    for name, vector in rows.items():
        table.add_row(escape(name), *(f"{component:.6g}" for component in vector))
    console.print(table)
    console.print(
        f"largest displacement {static['largest_displacement_m']:.6g} m at vertex "
        f"{static['largest_displacement_vertex']}, residual {static['residual']:.1e}, condition "
        f"{static['condition']:.1e}"
    )
    if len(static["support_force_n"]) > 1:  # a single one's is the sum above
        _print_supports(static["support_force_n"], console)
