"""Nodes, elements and sets of input files of Abaqus and CalculiX; what else is in them is left to their solvers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trocar.services.meshes.cells import Cells, surface_of
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.file_kind import plain_text
from trocar.services.meshes.surface_data import Int64Array, SurfaceData

_KINDS = (
    (r"S3|S3R|S3RS|STRI3|M3D3|R3D3|CPS3|CPE3|CAX3|SFM3D3|DS3", "triangle", 3),
    (r"S6|STRI65|M3D6|CPS6M?|CPE6M?|CAX6M?|SFM3D6|DS6", "triangle6", 6),
    (r"S4|S4R|S4RS|S4RSW|S4R5|M3D4R?|R3D4|CPS4[RI]?|CPE4[RI]?|CAX4R?|SFM3D4R?|DS4", "quad", 4),
    (r"S8|S8R|S8R5|M3D8R?|CPS8R?|CPE8R?|CAX8R?|SFM3D8R?|DS8", "quad8", 8),
    (r"S9R5|M3D9R?", "quad9", 9),
    (r"[BT]\w*2H?|B31\w*|B21\w*|[BT]3D2\w*|R[AB]?\w*2D2|SPRINGA|DASHPOTA", "line", 2),
    (r"B32\w*|B22\w*|T[23]D3\w*", "line3", 3),
    (r"C3D4\w*|DC3D4", "tetra", 4),
    (r"C3D6\w*|SC6R|DC3D6", "wedge", 6),
    (r"C3D8\w*|SC8R|DC3D8", "hexahedron", 8),
    (r"C3D10\w*", "tetra10", 10),
    (r"C3D15\w*", "wedge15", 15),
    (r"C3D20\w*", "hexahedron20", 20),
    (r"MASS|SPRING1|DASHPOT1|ROTARYI", "vertex", 1),
)  # fmt: skip
"""Types of elements, the kind of cell that each is, and its number of nodes."""
_OTHER_MESH = {
    "INCLUDE": "includes another file, which is not read: put both into one",
    "SYSTEM": "gives nodes in axes of their own, which is not read: write them in those of the whole",
    "IMPORT": "takes the mesh of another analysis, which is not read",
    **dict.fromkeys(
        ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"),
        "makes or changes nodes or elements, which is not read: write the mesh as it is then",
    ),
}
"""Keywords without which the mesh would be another one than the solver's, and why they are refused."""
_OTHER_PLACE = {
    "INPUT": "reads values from another file, which is not read: put both into one",
    "SYSTEM": "gives nodes in cylindrical or spherical coordinates, which is not read: write x, y, z",
}
"""Parameters of keywords that are read, likewise; ``SYSTEM=R`` is the usual one."""

_MOST_GENERATED = 100_000_000


@dataclass(slots=True)
class _Model:
    path: Path
    number: dict[int, int] = field(default_factory=dict)  # of a node in the file, its place
    places: list[tuple[float, float, float]] = field(default_factory=list)
    elements: list[tuple[str, list[int], Int64Array]] = field(default_factory=list)  # kind, numbers, nodes
    known: set[int] = field(default_factory=set)  # numbers of elements
    node_sets: dict[str, list[int | str]] = field(default_factory=dict)
    element_sets: dict[str, list[int | str]] = field(default_factory=dict)
    of_elements: list[tuple[int, str, str]] = field(default_factory=list)  # line, a node set, whose elements it is of

    def name_of(self, name: str, sets: dict[str, list[int | str]]) -> str:
        """Return a set's name as it was first written: capitals and small letters are the same."""
        return next((known for known in sets if known.upper() == name.upper()), name)

    def refuse(self, line: int, what: str) -> MeshError:
        return MeshError(f"{self.path}: line {line}: {what}")


@dataclass(frozen=True, slots=True)
class _Block:
    """A keyword with its parameters, and the rows of values below it."""

    line: int
    keyword: str
    parameters: dict[str, str]
    rows: list[tuple[int, list[str]]]


def read_inp(path: Path) -> SurfaceData:
    """Return the faces of shell, membrane and plane elements, with node and element sets as sets of vertices.

    Raises MeshError that names the line: one that is cut off or no number, a type that is not known, an element of
    another number of nodes, a set or element that names what is not there, several parts, or a keyword by which the
    mesh is another than is written, as that of an included file.
    """
    model = _Model(path)
    for block in _blocks(path):
        if block.keyword in _OTHER_MESH and (block.rows or block.keyword != "SYSTEM"):
            raise model.refuse(block.line, f"*{block.keyword} {_OTHER_MESH[block.keyword]}")
        read = _READERS.get(block.keyword)
        if read is not None:
            _judge_parameters(model, block)
            read(model, block)
    if not model.number:
        raise MeshError(f"{path}: has no nodes")
    return surface_of(path, np.array(model.places), _cells(model), _node_sets(model))


def _judge_parameters(model: _Model, block: _Block) -> None:
    for name, why in _OTHER_PLACE.items():
        value = block.parameters.get(name)
        if value is not None and (name, value.upper()) != ("SYSTEM", "R"):
            raise model.refuse(block.line, f"*{block.keyword}, {name}={value} {why}")


def _blocks(path: Path) -> Iterator[_Block]:
    """Yield keywords with their rows; a keyword's line that ends with a comma goes on in the next."""
    text = plain_text(path.read_bytes()).decode("utf-8", "replace")
    block: _Block | None = None
    goes_on = False
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if not stripped or stripped.startswith("**"):
            continue
        if block is not None and goes_on and not stripped.startswith("*"):
            block.parameters.update(_parameters(stripped.split(",")))
            goes_on = stripped.endswith(",")
        elif stripped.startswith("*"):
            if block is not None:
                yield block
            keyword, *rest = stripped[1:].split(",")
            block = _Block(number, " ".join(keyword.upper().split()), _parameters(rest), [])
            goes_on = stripped.endswith(",")
        elif block is not None:
            block.rows.append((number, [each.strip() for each in stripped.split(",")]))
        else:
            raise MeshError(f"{path}: line {number}: comes before any keyword: '{stripped[:40]}'")
    if block is not None:
        yield block


def _parameters(parts: list[str]) -> dict[str, str]:
    pairs = (each.partition("=") for each in parts if each.strip())
    return {name.strip().upper(): value.strip().strip('"') for name, _, value in pairs}


def _read_nodes(model: _Model, block: _Block) -> None:
    found: list[int | str] = []
    for line, values in block.rows:
        try:
            number, place = _whole_number(values[0]), [_number(each) for each in _without_end(values)[1:4]]
        except ValueError as error:
            raise model.refuse(line, f"a node: {error}") from None
        if not 2 <= len(place) <= 3:
            raise model.refuse(line, f"node {number} has {len(place)} coordinates: is the line cut off?")
        if number in model.number:
            raise model.refuse(line, f"node {number} is there twice; of several parts only one can be read")
        model.number[number] = len(model.places)
        model.places.append((*place, 0.0)[:3])  # type: ignore[arg-type]
        found.append(number)
    if "NSET" in block.parameters:
        model.node_sets.setdefault(model.name_of(block.parameters["NSET"], model.node_sets), []).extend(found)


def _without_end(values: list[str]) -> list[str]:
    """Return values up to the last one that is there."""
    return values[: max((k for k, each in enumerate(values, 1) if each), default=0)]


def _whole_number(text: str) -> int:
    if not re.fullmatch(r"[-+]?\d{1,18}", text, re.ASCII):
        raise ValueError(f"'{text}' is no whole number")
    return int(text)


def _number(text: str) -> float:
    """Return a number as Fortran writes it; where there is none between commas, it is 0."""
    if not re.fullmatch(r"[-+.\w]*", text, re.ASCII) or "_" in text:
        raise ValueError(f"'{text}' is no number")
    return float(text.upper().replace("D", "E") if re.search(r"\dD|\.D", text, re.IGNORECASE) else text or "0")


def _read_elements(model: _Model, block: _Block) -> None:
    type_name = block.parameters.get("TYPE", "").upper()
    kind, n = next(((kind, n) for types, kind, n in _KINDS if re.fullmatch(types, type_name)), ("", 0))
    if not kind:
        raise model.refuse(block.line, f"elements of type '{type_name}' are not known")
    values = [(line, each) for line, row in block.rows for each in row if each]
    if len(values) % (n + 1):
        line = values[-1][0] if values else block.line
        raise model.refuse(line, f"the last element of type {type_name} has not {n} nodes: is the file cut off?")
    try:
        table = np.array([int(each) for _, each in values], np.int64).reshape(-1, n + 1)
    except (ValueError, OverflowError):
        line, wrong = next((line, each) for line, each in values if not re.fullmatch(r"[-+]?\d{1,18}", each))
        raise model.refuse(line, f"'{wrong}' is no number of a node or an element") from None
    numbers = table[:, 0].tolist()
    if len(model.known) + len(numbers) > len(model.known | set(numbers)):
        seen = model.known.copy()
        twice = next(each for each in numbers if each in seen or seen.add(each))  # type: ignore[func-returns-value]
        raise model.refuse(block.line, f"element {twice} is there twice; of several parts only one can be read")
    model.known.update(numbers)
    name = block.parameters.get("ELSET", "")
    if name:
        model.element_sets.setdefault(model.name_of(name, model.element_sets), []).extend(numbers)
    model.elements.append((kind, numbers, table[:, 1:]))


def _read_set(model: _Model, block: _Block, key: str, sets: dict[str, list[int | str]]) -> None:
    name = model.name_of(block.parameters.get(key, ""), sets)
    members = sets.setdefault(name, [])
    if key == "NSET" and "ELSET" in block.parameters:
        model.of_elements.append((block.line, name, block.parameters["ELSET"]))
    for line, values in block.rows:
        given = [each for each in values if each]
        if "GENERATE" in block.parameters:
            members.extend(_generated(model, line, given))
        else:
            members.extend(int(each) if re.fullmatch(r"\d{1,18}", each) else each for each in given)


def _generated(model: _Model, line: int, given: list[str]) -> range:
    try:
        first, last, step = (*map(_whole_number, given), 1)[:3]
        found = range(first, last + 1, step)
    except ValueError as error:
        raise model.refuse(line, f"a generated set wants first, last and step: {error}") from None
    if (n := (last - first) // step + 1) > _MOST_GENERATED:
        raise model.refuse(line, f"a generated set has {n} members")
    return found


def _refuse_part(model: _Model, block: _Block) -> None:
    """Refuse an instance that is moved, whose nodes lie elsewhere than the file says."""
    if block.rows:
        raise model.refuse(block.rows[0][0], "moves an instance of a part, which is not read: write the mesh in place")


_READERS: dict[str, Callable[[_Model, _Block], None]] = {
    "NODE": _read_nodes,
    "ELEMENT": _read_elements,
    "NSET": lambda model, block: _read_set(model, block, "NSET", model.node_sets),
    "ELSET": lambda model, block: _read_set(model, block, "ELSET", model.element_sets),
    "INSTANCE": _refuse_part,
}


def _members(model: _Model, sets: dict[str, list[int | str]], name: str, above: tuple[str, ...] = ()) -> Iterator[int]:
    """Yield the numbers in a set, and those in the sets that it names."""
    for each in sets[name]:
        if isinstance(each, int):
            yield each
            continue
        other = model.name_of(each, sets)
        if other in above or other == name:
            raise MeshError(f"{model.path}: the set '{name}' holds itself")
        if other not in sets:
            raise MeshError(f"{model.path}: the set '{name}' names '{each}', which is no set and no number")
        yield from _members(model, sets, other, (*above, name))


def _node_sets(model: _Model) -> dict[str, Int64Array]:
    found: dict[str, Int64Array] = {}
    for line, name, elements in model.of_elements:
        model.node_sets[name] += _nodes_of(model, line, elements)
    for name in model.node_sets:
        numbers = list(_members(model, model.node_sets, name))
        strange = next((each for each in numbers if each not in model.number), None)
        if strange is not None:
            raise MeshError(f"{model.path}: the set '{name}' names node {strange}, which is not there")
        found[name] = np.array(sorted({model.number[each] for each in numbers}), np.int64)
    return found


def _nodes_of(model: _Model, line: int, name: str) -> list[int]:
    """Return the nodes of the elements of a set."""
    known = model.name_of(name, model.element_sets)
    if known not in model.element_sets:
        raise model.refuse(line, f"is of the nodes of the element set '{name}', which is not there")
    wanted = set(_members(model, model.element_sets, known))
    return [
        node
        for _, numbers, nodes in model.elements
        for number, row in zip(numbers, nodes.tolist(), strict=True)
        if number in wanted
        for node in row
    ]


def _cells(model: _Model) -> Iterator[Cells]:
    """Yield the elements as cells, each block with its part of every set; unknown numbers in a set are refused."""
    wanted = {name: set(_members(model, model.element_sets, name)) for name in model.element_sets}
    for name, some in wanted.items():
        if strange := some - model.known:
            raise MeshError(f"{model.path}: the set '{name}' names element {min(strange)}, which is not there")
    for kind, numbers, nodes in model.elements:
        try:
            placed = np.array([[model.number[node] for node in row] for row in nodes.tolist()], np.int64)
        except KeyError as error:
            row = next(k for k, row in enumerate(nodes.tolist()) if error.args[0] in row)
            raise MeshError(
                f"{model.path}: element {numbers[row]} names node {error.args[0]}, which is not there"
            ) from None
        places = ((name, [k for k, number in enumerate(numbers) if number in some]) for name, some in wanted.items())
        members = {name: np.array(found, np.int64) for name, found in places if found}
        yield Cells(kind, placed.reshape(len(numbers), nodes.shape[1]), members)
