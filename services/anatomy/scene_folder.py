"""The folder that `trocar anatomy` writes: surface, scene, picture and report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.anatomy.making import ANTERIOR, MadeAnatomy, rounded_mm
from trocar.services.anatomy.proposal import BEFORE_MOUTH_M, INTRODUCER_TO_TIP_M
from trocar.services.files.atomic_file import atomic_file

SURFACE, SCENE, PICTURE, REPORT, FACTS = "surface.vtp", "scene.yaml", "preview.png", "report.md", "report.json"
SCENARIO = "scenario.yaml"
GRAVITY_M_S2 = 9.81  # the standard acceleration of ISO 80000-3, 9.80665, rounded
GOAL_ROOM_M = 10e-3  # assumption, as the scenario that is written says


def write_folder(made: MadeAnatomy, folder: Path) -> None:
    """Write surface, scene and report; the picture is drawn by `preview.draw_preview`."""
    folder.mkdir(parents=True, exist_ok=True)
    _write_surface(made, folder / SURFACE)
    told = facts(made)
    for name, text in (
        (SCENE, scene_text(made)),
        (FACTS, json.dumps(told, indent=1) + "\n"),
        (REPORT, report_text(told)),
    ):
        with atomic_file(folder / name) as half:
            half.write_text(text, encoding="utf-8")
    if made.goal is None:
        (folder / SCENARIO).unlink(missing_ok=True)
    else:
        with atomic_file(folder / SCENARIO) as half:
            half.write_text(scenario_text(made, folder), encoding="utf-8")


def _write_surface(made: MadeAnatomy, path: Path) -> None:
    import pyvista

    mesh = made.duct.mesh
    surface = pyvista.PolyData.from_regular_faces(1e3 * mesh.vertices_m, mesh.triangles)
    with atomic_file(path) as half:
        surface.save(half)


def scene_text(made: MadeAnatomy) -> str:
    """Return the scene file."""
    down = made.axes @ (-GRAVITY_M_S2 * np.array(ANTERIOR))
    ports = [f"[{', '.join(f'{x:g}' for x in port)}]" for port in made.ports_m]
    return f"""# Made by `trocar anatomy` from {made.path.name}; what was done and measured: {REPORT}.
# The surface is in millimetres in the patient's LPS axes; in the scene the held end is the origin, the mouth
# lies on +x, and the patient's front is up as far as that allows. The catheter lies before the mouth and looks into it.
duct:
  mesh_file: {SURFACE}
  mesh_unit: mm
  mesh_names: [{", ".join(made.names)}] # the open ends, the widest first
  mesh_clamped: [{", ".join(made.choice.held)}]
  mesh_mouth: {made.choice.mouth}
  mesh_up: [{", ".join(f"{x:g}" for x in ANTERIOR)}] # the patient's front
  thickness_m: {made.wall.thickness_m:.3g} # {made.wall.source}
  youngs_modulus_pa: 300.0e+3 # an assumption
  n_modes: 60
catheter:
  product: {made.duct.catheter} # the widest of those known that passes
  length_m: 0.13
  n_segments: 40
  before_mouth_m: {BEFORE_MOUTH_M:g}
  introducer_to_tip_m: {INTRODUCER_TO_TIP_M:g}
  introducer_length_m: 40.0e-3
  introducer_friction: 0.05
  introducer_seal_friction_n: 20.0e-3
forceps:
  - {{port_position_m: {ports[0]}}}
  - {{port_position_m: {ports[1]}, jaw_max_angle_rad: 1.2}}
effects:
  gravity: {{acceleration_m_s2: [{", ".join(f"{x:.4g}" for x in down)}]}} # the patient lies on the back
  friction: {{}}
  grasp_slip: {{}}
"""


def scenario_text(made: MadeAnatomy, folder: Path) -> str:
    """Return a scenario with the goal."""
    assert made.goal is not None
    return f"""# Made by `trocar anatomy` from {made.path.name}.
title: Reach the marked place
hint: Grasp the catheter, lead its tip into {made.choice.mouth}, and push it towards {made.goal.end}.
scene: {json.dumps(str(folder.absolute() / SCENE))}
goal: {{branch: {made.goal.end}, depth_m: {made.goal.depth_m:g}}}
limits: # the goal with room on either side
  depth_max_m: {{value: {made.goal.depth_m + GOAL_ROOM_M:g}, source: assumption}}
  depth_min_m: {{value: {max(0.0, made.goal.depth_m - GOAL_ROOM_M):g}, source: assumption}}
"""


def facts(made: MadeAnatomy) -> dict[str, Any]:
    """Return all that was done and measured; lengths in mm, places in the patient's LPS axes."""
    volume, surface = made.surface.volume, made.surface
    lumen_mm = [1e3 * (line.diameters_m - made.wall.thickness_m) for line in made.duct.lines]
    spread = made.wall.spread_m
    return {
        "file": str(made.path),
        "label": None if volume is None else volume.label,
        "labels": None if volume is None else volume.labels,
        "voxel_mm": None if volume is None else [round(1e3 * float(x), 4) for x in volume.spacing_m],
        "size_voxels": None if volume is None else volume.size,
        "done": [*surface.actions, *_opened(made)],
        "wall": {
            "thickness_mm": round(1e3 * made.wall.thickness_m, 3), "source": made.wall.source,
            "from_5_to_95_percent_mm": None if spread is None else [round(1e3 * x, 3) for x in spread],
            "surface_of_file": "middle of the wall" if made.request.is_middle else "lumen",
        },
        "ends": [
            {
                "name": end.name, "at_mm": rounded_mm(end.opening.centre_m),
                "direction": np.round(end.opening.direction, 3).tolist(),
                "width_mm": round(1e3 * end.opening.diameter_m, 2), "named": end.why,
                "is": "mouth" if end.name == made.choice.mouth else "held" if end.name in made.choice.held else "free",
            }
            for end in made.duct.ends
        ],
        "mouth": {"name": made.choice.mouth, "why": made.choice.why},
        "ways": [
            {
                "length_mm": round(1e3 * float(line.at_m[-1]), 1), "narrowest_lumen_mm": round(float(lumen.min()), 2),
                "narrowest_at_mm": rounded_mm(line.points_m[int(lumen.argmin())]),
                "median_lumen_mm": round(float(np.median(lumen)), 2),
                "centreline_mm": np.round(1e3 * line.points_m, 3).tolist(),
            }
            for line, lumen in zip(made.duct.lines, lumen_mm, strict=True)
        ],
        "moved": {
            "surface_from_voxel_faces_mm": _three(surface.boundary_error_m),
            "shell_from_surface_mm": [round(1e3 * x, 3) for x in made.duct.moved_m],
        },
        "mesh": {
            "vertices": made.duct.mesh.n_vertices, "triangles": made.duct.mesh.n_triangles,
            "edge_mm": round(1e3 * made.duct.edge_m, 3),
        },
        "catheter": made.duct.catheter,
        "ports_m": made.ports_m,
        "goal": None if made.goal is None else {"end": made.goal.end, "depth_mm": round(1e3 * made.goal.depth_m, 1)},
        "scene_from_patient": {"origin_m": made.origin_m.tolist(), "axes": made.axes.tolist()},
        "seconds": made.seconds,
    }  # fmt: skip


def _opened(made: MadeAnatomy) -> list[str]:
    wall, edge = 1e3 * made.wall.thickness_m, 1e3 * made.duct.edge_m
    moved = [] if made.request.is_middle else [f"moved the surface out by half the wall, {0.5 * wall:.3g} mm"]
    return [
        *moved,
        f"cut {len(made.duct.ends)} ends open, square to the centreline",
        f"remeshed to {made.duct.mesh.n_triangles} triangles with edges of {edge:.2g} mm",
    ]


def _three(values_m: tuple[float, float, float] | None) -> list[float] | None:
    return None if values_m is None else [round(1e3 * x, 3) for x in values_m]


def report_text(told: dict[str, Any]) -> str:
    """Return the report that a person reads."""
    wall, mesh = told["wall"], told["mesh"]
    spread = wall["from_5_to_95_percent_mm"]
    varies = f", 5 to 95 %: {spread[0]:g} to {spread[1]:g} mm" if spread else ""
    parts = [
        f"# {Path(told['file']).name}",
        *_label_lines(told),
        "## What was done",
        "\n".join(f"- {each}" for each in told["done"]),
        "## How far the surface moved",
        "\n".join(_moved_lines(told["moved"])),
        "## Wall",
        f"{wall['thickness_mm']:g} mm: {wall['source']}{varies}. The file's surface is taken for the "
        f"{wall['surface_of_file']}.",
        "## Ends",
        "Places are in mm in the patient's LPS axes.",
        _table(
            ("end", "at", "width, mm", "is", "named"),
            [(e["name"], _place(e["at_mm"]), f"{e['width_mm']:g}", e["is"], e["named"]) for e in told["ends"]],
        ),
        f"Mouth: {told['mouth']['name']} ({told['mouth']['why']}). `--mouth`, `--held` and `--name` change this.",
        "## Ways from end to end",
        _table(
            ("length, mm", "median lumen, mm", "narrowest, mm", "there"),
            [(*(f"{w[key]:g}" for key in _WAY_KEYS), _place(w["narrowest_at_mm"])) for w in told["ways"]],
        ),
        f"Catheter: {told['catheter']}, the widest of those known that passes. The shell has {mesh['vertices']} "
        f"vertices and edges of {mesh['edge_mm']:g} mm.",
    ]
    return "\n\n".join(parts) + "\n"


_WAY_KEYS = "length_mm", "median_lumen_mm", "narrowest_lumen_mm"


def _label_lines(told: dict[str, Any]) -> list[str]:
    if told["label"] is None:
        return []
    voxel = " x ".join(f"{x:g}" for x in told["voxel_mm"])
    return [f"Label '{told['label']}' of {len(told['labels'])}, voxels of {voxel} mm."]


def _moved_lines(moved: dict[str, Any]) -> list[str]:
    most, far = moved["shell_from_surface_mm"]
    lines = [f"- shell from the smooth surface: 95 % {most:g}, at most {far:g} mm"]
    if faces := moved["surface_from_voxel_faces_mm"]:
        middle, most, far = faces
        lines.insert(
            0, f"- smooth surface from the voxels' faces: median {middle:g}, 95 % {most:g}, at most {far:g} mm"
        )
    return lines


def _place(at_mm: list[float]) -> str:
    return ", ".join(f"{x:g}" for x in at_mm)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows))
