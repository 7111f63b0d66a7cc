"""Right files of every kind, made here: small, as other programs write them."""

from __future__ import annotations

import base64
import io
import struct
import tempfile
import zlib
from pathlib import Path

import msgspec
import numpy as np

from tests.made_samples import SUCCESS
from tests.protocol import samples
from tests.recorder.made_up import MS, long_recording
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.recorder.recording import RecordingWriter

TUBE = parametric_duct(DuctGeometry(4e-3, 40e-3, 12, 10))


def _mm(mesh: TriangleMesh) -> np.ndarray:
    return 1e3 * mesh.vertices_m


def text_stl(mesh: TriangleMesh, begins: str = "solid tube", ends: str = "endsolid tube\n") -> bytes:
    corners = _mm(mesh)[mesh.triangles]
    facets = (
        "facet normal 0 0 0\n outer loop\n"
        + "".join("  vertex {:.7g} {:.7g} {:.7g}\n".format(*point) for point in triangle)
        + " endloop\nendfacet\n"
        for triangle in corners
    )
    return f"{begins}\n{''.join(facets)}{ends}".encode()


def binary_stl(mesh: TriangleMesh, header: bytes = b"") -> bytes:
    records = np.zeros(mesh.n_triangles, np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    records["c"] = _mm(mesh)[mesh.triangles]
    return header.ljust(80, b"\0") + struct.pack("<I", mesh.n_triangles) + records.tobytes()


def obj(mesh: TriangleMesh, faces: str | None = None) -> bytes:
    vertices = "".join("v {:.9g} {:.9g} {:.9g}\n".format(*point) for point in _mm(mesh))
    triangles = "".join("f {} {} {}\n".format(*(triangle + 1)) for triangle in mesh.triangles)
    return (vertices + (triangles if faces is None else faces)).encode()


def mixed_faces(mesh: TriangleMesh) -> list[list[int]]:
    """Return the faces of a tube: of two triangles in a row that make a flat quadrangle, every second pair is one."""
    faces: list[list[int]] = []
    for k in range(0, mesh.n_triangles - 1, 2):
        (a, b, c), (d, e, f) = mesh.triangles[k].tolist(), mesh.triangles[k + 1].tolist()
        if k % 4 == 0 and (a, c) == (d, e):
            faces.append([a, b, c, f])
        else:
            faces += [[a, b, c], [d, e, f]]
    return faces


def ply(
    mesh: TriangleMesh, form: str = "ascii", faces: list[list[int]] | None = None, notes: str = "", real: str = "float"
) -> bytes:
    faces = mesh.triangles.tolist() if faces is None else faces
    head = (
        f"ply\nformat {form} 1.0\n{notes}element vertex {mesh.n_vertices}\nproperty {real} x\nproperty {real} y\n"
        f"property {real} z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = ["{:.9g} {:.9g} {:.9g}\n".format(*point) for point in _mm(mesh)]
        rows += [f"{len(face)} {' '.join(map(str, face))}\n" for face in faces]
        return head + "".join(rows).encode()
    order = "<" if "little" in form else ">"
    points = _mm(mesh).astype(f"{order}f{4 if real == 'float' else 8}").tobytes()
    return head + points + b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)


def strips_ply(mesh: TriangleMesh) -> bytes:
    """Return each triangle as a strip of three, two of them in one list with the mark between."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {mesh.n_vertices}\nproperty float x\nproperty float y\n"
        "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    ).encode()
    strip = np.concatenate([np.append(triangle, -1) for triangle in mesh.triangles]).astype("<i4")
    return head + _mm(mesh).astype("<f4").tobytes() + struct.pack("<i", len(strip)) + strip.tobytes()


def vtp(mesh: TriangleMesh, form: str = "ascii", lines: bool = False, comment: str = "") -> bytes:
    arrays = {
        "points": _mm(mesh), "connectivity": mesh.triangles.ravel().astype("<i8"),
        "offsets": 3 * np.arange(1, mesh.n_triangles + 1, dtype="<i8"),
    }  # fmt: skip
    appended = b""

    def data(name: str, kind: str, components: int = 1) -> str:
        nonlocal appended
        array = arrays[name]
        begin = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" '
        if form == "ascii":
            return f'{begin}format="ascii">{" ".join(map(repr, array.ravel().tolist()))}</DataArray>\n'
        raw = array.tobytes()
        block = zlib.compress(raw)
        packed = struct.pack("<4I", 1, len(raw), len(raw), len(block)) + block if form == "zlib" else None
        if form == "base64":
            return (
                f'{begin}format="binary">{base64.b64encode(struct.pack("<I", len(raw)) + raw).decode()}</DataArray>\n'
            )
        at = len(appended)
        appended += packed if packed is not None else struct.pack("<I", len(raw)) + raw
        return f'{begin}format="appended" offset="{at}"/>\n'

    points = data("points", "Float64", 3)
    polys = data("connectivity", "Int64") + data("offsets", "Int64")
    line = ""
    if lines:
        line = (
            '<Lines><DataArray type="Int64" Name="connectivity" format="ascii">0 5 9</DataArray>'
            '<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray></Lines>\n'
        )
    compressor = ' compressor="vtkZLibDataCompressor"' if form == "zlib" else ""
    text = (
        f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"{compressor}>\n'
        f'<PolyData>{comment}<Piece NumberOfPoints="{mesh.n_vertices}" NumberOfLines="{int(lines)}" '
        f'NumberOfPolys="{mesh.n_triangles}">\n<Points>{points}</Points>\n{line}<Polys>{polys}</Polys>\n'
        "</Piece></PolyData>\n"
    ).encode()
    if appended:
        text += b'<AppendedData encoding="raw">_' + appended + b"</AppendedData>\n"
    return text + b"</VTKFile>\n"


def inp(mesh: TriangleMesh) -> bytes:
    """Return an input file of CalculiX: shells, with sets of nodes and elements."""
    nodes = "".join(f"{k}, {x:.9g}, {y:.9g}, {z:.9g}\n" for k, (x, y, z) in enumerate(_mm(mesh).tolist(), 1))
    shells = "".join(f"{k}, {a + 1}, {b + 1}, {c + 1}\n" for k, (a, b, c) in enumerate(mesh.triangles.tolist(), 1))
    rim = ", ".join(str(k + 1) for k in mesh.vertex_sets["clamped"].tolist())
    return (
        f"*HEADING\n a tube\n** a comment\n*NODE, NSET=ALL\n{nodes}*ELEMENT, TYPE=S3, ELSET=WALL\n{shells}"
        f"*NSET, NSET=RIM\n{rim}\n*ELSET, ELSET=FIRST, GENERATE\n1, 9, 2\n*STEP\n*STATIC\n*END STEP\n"
    ).encode()


def _rim_edges(mesh: TriangleMesh) -> np.ndarray:
    rim = mesh.vertex_sets["clamped"]
    return np.stack([rim, np.roll(rim, -1)], axis=1)


def gmsh22(mesh: TriangleMesh, binary: bool) -> bytes:
    """Return a file of Gmsh 2.2, with physical groups of the wall and of the rim's edges."""
    import meshio

    edges = _rim_edges(mesh)
    tags = [np.full(len(mesh.triangles), 1, np.int32), np.full(len(edges), 2, np.int32)]
    cells = [("triangle", mesh.triangles), ("line", edges)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    made = meshio.Mesh(_mm(mesh), cells, cell_data=data, field_data={"wall": np.array([1, 2]), "rim": np.array([2, 1])})
    with tempfile.NamedTemporaryFile(suffix=".msh") as file:
        meshio.gmsh.write(file.name, made, fmt_version="2.2", binary=binary)
        return Path(file.name).read_bytes()


def gmsh41(mesh: TriangleMesh, binary: bool) -> bytes:
    """Return the same in the layout of Gmsh 4.1, whose entities have the physical groups."""

    def sizes(*values: int) -> bytes:
        return np.array(values, "<u8").tobytes() if binary else f"{' '.join(map(str, values))}\n".encode()

    def ints(*values: int) -> bytes:
        return np.array(values, "<i4").tobytes() if binary else f"{' '.join(map(str, values))} ".encode()

    def reals(values: np.ndarray) -> bytes:
        return (
            values.astype("<f8").tobytes() if binary else (" ".join(map(repr, values.ravel().tolist())) + "\n").encode()
        )

    def entity(physical: int) -> bytes:
        return ints(1) + reals(np.zeros(6)) + sizes(1) + ints(physical) + sizes(0)

    n, edges = mesh.n_vertices, _rim_edges(mesh)
    numbers = np.arange(1, n + 1)
    blocks = b""
    first = 1
    for dimension, kind, nodes in ((1, 1, edges), (2, 2, mesh.triangles)):
        blocks += ints(dimension, 1, kind) + sizes(len(nodes))
        rows = np.column_stack([np.arange(first, first + len(nodes)), nodes + 1])
        blocks += sizes(*rows.ravel().tolist()) if binary else b"".join(sizes(*row) for row in rows.tolist())
        first += len(nodes)
    places = _mm(mesh)
    held = reals(places) if binary else b"".join(reals(place) for place in places)
    named = sizes(*numbers.tolist()) if binary else b"".join(sizes(k) for k in numbers.tolist())
    one = np.array([1], "<i4").tobytes() + b"\n" if binary else b""
    end = b"\n" if binary else b""
    return (
        f"$MeshFormat\n4.1 {int(binary)} 8\n".encode() + one + b"$EndMeshFormat\n"
        b'$PhysicalNames\n2\n1 2 "rim"\n2 1 "wall"\n$EndPhysicalNames\n'
        b"$Entities\n" + sizes(0, 1, 1, 0) + entity(2) + entity(1) + end + b"$EndEntities\n"
        b"$Nodes\n" + sizes(1, n, 1, n) + ints(2, 1, 0) + sizes(n) + named + held + end + b"$EndNodes\n"
        b"$Elements\n" + sizes(2, first - 1, 1, first - 1) + blocks + end + b"$EndElements\n"
    )


def vtu(mesh: TriangleMesh) -> bytes:
    """Return a VTU file, with the rim as 0 and 1 on its points."""
    import meshio

    rim = np.zeros(mesh.n_vertices, np.int8)
    rim[mesh.vertex_sets["clamped"]] = 1
    parts = [np.arange(mesh.n_triangles, dtype=np.int32) % 3]
    made = meshio.Mesh(_mm(mesh), [("triangle", mesh.triangles)], {"rim": rim}, {"part": parts})
    with tempfile.NamedTemporaryFile(suffix=".vtu") as file:
        meshio.vtu.write(file.name, made)
        return Path(file.name).read_bytes()


def of_finite_elements() -> dict[str, bytes]:
    """Return right files of finite elements by name, of the same tube."""
    return {
        "shells.inp": inp(TUBE),
        "grid.vtu": vtu(TUBE),
        "gmsh22.msh": gmsh22(TUBE, False),
        "gmsh22-binary.msh": gmsh22(TUBE, True),
        "gmsh41.msh": gmsh41(TUBE, False),
        "gmsh41-binary.msh": gmsh41(TUBE, True),
    }


def surfaces() -> dict[str, bytes]:
    """Return right files by name, of a small tube."""
    return {
        "text.stl": text_stl(TUBE),
        "binary.stl": binary_stl(TUBE),
        "solid.stl": binary_stl(TUBE, b"solid by another program"),
        "plain.obj": obj(TUBE),
        "quads.obj": obj(TUBE, "".join(f"f {' '.join(str(k + 1) for k in face)}\n" for face in mixed_faces(TUBE))),
        "text.ply": ply(TUBE),
        "little.ply": ply(TUBE, "binary_little_endian", mixed_faces(TUBE)),
        "big.ply": ply(TUBE, "binary_big_endian", real="double"),
        "strips.ply": strips_ply(TUBE),
        **{f"{form}.vtp": vtp(TUBE, form) for form in ("ascii", "base64", "raw", "zlib")},
        **of_finite_elements(),
    }


def recordings(folder: Path) -> dict[str, bytes]:
    """Return recordings by name: of one topic, of all with attachments, of a whole rig, and torn ones."""
    writer = long_recording(folder / "whole-devices.mcap", 600)
    writer.close()
    everything = RecordingWriter(folder / "whole-all.mcap", {"rig": "stub", "scene": "insertion"})
    everything.attach("scene.yaml", "application/yaml", b"name: insertion\n")
    packed = io.BytesIO()
    np.savez_compressed(packed, vertices_m=TUBE.vertices_m, triangles=TUBE.triangles, modes=np.zeros((2, 3, 1)))
    everything.attach("duct.npz", "application/x-npz", packed.getvalue())
    for tick in range(40):
        for name in ("gateway.state", "haptics.journal", "physics.journal", "physics.state", "haptics.contacts"):
            everything.write(msgspec.structs.replace(samples.frame(name), sequence=tick, sent_ns=(tick + 1) * MS))
    everything.close()
    wholes = {path.name: path.read_bytes() for path in (writer.path, everything.path)}
    wholes["whole-rig.mcap"] = SUCCESS.read_bytes()
    torn = {name.replace("whole", "torn"): data[: -len(data) // 10] for name, data in wholes.items()}
    for path in (writer.path, everything.path):
        path.unlink()
    return wholes | torn
