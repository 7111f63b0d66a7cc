"""What Python puts into a struct is what a kernel finds there, or an error that names the field."""

from __future__ import annotations

import copy
import gc
import importlib
import os
import pickle
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader


class Material(Struct):
    density: float
    is_soft: bool


class Body(Struct):
    position: Annotated[FloatArray, "n", 3]
    rest: Annotated[FloatArray, "n", 3]
    frame: Annotated[FloatArray, "n", 3, 3]
    triangles: Annotated[IntArray, "m", 3]
    held: Annotated[BoolArray, 2, 2]
    material: Material
    tick: int = 0


body_at, material_at = reader(Body), reader(Material)


def _values(n: int = 4, m: int = 2) -> dict[str, object]:
    return {
        "position": np.arange(3.0 * n).reshape(n, 3),
        "rest": np.ones((n, 3)),
        "frame": np.arange(9.0 * n).reshape(n, 3, 3),
        "triangles": np.arange(3 * m, dtype=np.int32).reshape(m, 3),
        "held": np.zeros((2, 2), np.bool_),
        "material": Material(density=1000.0, is_soft=False),
    }


@kernel
def _read(address: Address[Body], node: int) -> tuple[float, float, int, int, int, float]:
    body = body_at(address)
    corner = body.triangles[1, 2]
    extents = 1000 * body.frame.shape[0] + 100 * body.frame.shape[1] + 10 * body.triangles.shape[0] + body.held.ndim
    return body.position[node, 1], body.frame[node, 2, 0], corner, extents, body.tick, body.material.density


@kernel
def _scale(row: FloatArray, factor: float) -> None:
    for axis in range(row.shape[0]):
        row[axis] *= factor


@kernel
def _write(address: Address[Body], node: int) -> None:
    body = body_at(address)
    body.tick += 1
    body.material.density *= 0.5
    body.material.is_soft = not body.material.is_soft
    body.held[1, 0] = True
    _scale(body.position[node], 2.0)


@kernel
def _density(address: Address[Material]) -> float:
    return material_at(address).density


def test_a_kernel_reads_arrays_numbers_and_structs_in_structs() -> None:
    body = Body(**_values(), tick=7)
    assert _read(body.address, 3) == (10.0, 33.0, 5, 4322, 7, 1000.0)
    assert _read(body.address, -1)[0] == 10.0, "an index counts from the end, as ever"


def test_python_sees_what_a_kernel_writes_and_the_other_way_round() -> None:
    body = Body(**_values())
    _write(body.address, 1)
    assert (body.tick, body.material.density, body.material.is_soft) == (1, 500.0, True)
    assert body.held.tolist() == [[False, False], [True, False]]
    np.testing.assert_array_equal(body.position[1], [6.0, 8.0, 10.0])
    body.tick, body.material.density, body.position[2, 1] = 5, 3.0, -1.0
    assert _read(body.address, 2) == (-1.0, 24.0, 5, 4322, 5, 3.0)


def test_structs_may_share_arrays_and_structs() -> None:
    one = Body(**_values())
    other = Body(**{**_values(), "position": one.position, "rest": one.position, "material": one.material})
    _write(one.address, 1)
    assert _read(other.address, 1)[0] == one.position[1, 1] == other.rest[1, 1] == 8.0
    assert _read(other.address, 1)[-1] == 500.0


def test_the_struct_keeps_alive_what_it_points_to() -> None:
    body = Body(**_values())
    position, material = weakref.ref(body.position), weakref.ref(body.material)
    gc.collect()
    assert position() is not None
    assert material() is not None
    assert _read(body.address, 3)[0] == 10.0
    body.position = np.full((4, 3), 2.0)
    assert position() is None
    assert _read(body.address, 3)[0] == 2.0


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"position": np.ones((4, 3), np.float32)}, TypeError, r"Body.position: .*float64 array \(n, 3\), got float32"),
        ({"triangles": np.ones((2, 3), np.int64)}, TypeError, "Body.triangles: .*int32 .* got int64"),
        ({"position": np.ones((4, 3), ">f8")}, TypeError, "Body.position: .* got >f8"),
        ({"position": None}, TypeError, "Body.position: .* got NoneType"),
        ({"position": [[0.0, 0.0, 0.0]] * 4}, TypeError, "Body.position: .* got list"),
        ({"position": np.ones(12)}, ValueError, r"Body.position: .* got shape \(12,\)"),
        ({"position": np.ones((4, 2))}, ValueError, r"Body.position: .* got shape \(4, 2\)"),
        ({"frame": np.ones((4, 3, 2))}, ValueError, r"Body.frame: .* got shape \(4, 3, 2\)"),
        ({"rest": np.ones((5, 3))}, ValueError, r"Body.rest: .* with n = 4, got shape \(5, 3\)"),
        ({"position": np.ones((4, 6))[:, ::2]}, ValueError, "Body.position: .*contiguous"),
        ({"position": np.ones((3, 4)).T}, ValueError, "Body.position: .*contiguous"),
        ({"position": np.ones(97, np.int8)[1:].view(np.float64).reshape(4, 3)}, ValueError, "Body.position: .*aligned"),
        ({"tick": 1.0}, TypeError, "Body.tick: expected int, got 1.0"),
        ({"tick": "1"}, TypeError, "Body.tick: expected int, got '1'"),
        ({"material": None}, TypeError, "Body.material: expected a Material, got NoneType"),
        ({"speed": 1.0}, TypeError, "Body.speed: no such field"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(wrong: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        Body(**{**_values(), **wrong})


@pytest.mark.parametrize("name", ["position", "held", "material"])
def test_a_forgotten_field_is_refused_by_name(name: str) -> None:
    values = _values()
    del values[name]
    with pytest.raises(TypeError, match=rf"Body.{name}: is missing"):
        Body(**values)
    with pytest.raises(TypeError, match=r"Material.density: expected float, got '3e-4'"):
        Material(density="3e-4", is_soft=False)


def test_later_changes_are_checked_too() -> None:
    body = Body(**_values())
    with pytest.raises(ValueError, match=r"Body.position: .* with n = 4"):
        body.position = np.ones((5, 3))
    with pytest.raises(TypeError, match=r"Body.tick: expected int"):
        body.tick = 0.5
    with pytest.raises(AttributeError, match=r"Body.postion: no such field"):
        body.postion = np.ones((4, 3))
    assert _read(body.address, 3)[0] == 10.0


def test_a_field_of_no_known_type_is_refused_when_the_class_is_made() -> None:
    for annotation in (FloatArray, Annotated[FloatArray, 1.5], str):
        with pytest.raises(TypeError, match=r"Wrong.field: a field is"):
            type("Wrong", (Struct,), {"__annotations__": {"field": annotation}})
    with pytest.raises(TypeError, match=r"Wrong.field: only numbers have a default"):
        type("Wrong", (Struct,), {"__annotations__": {"field": Annotated[FloatArray, 3]}, "field": np.zeros(3)})


def test_the_address_of_another_struct_is_refused() -> None:
    body = Body(**_values())
    assert _density(body.material.address) == 1000.0
    with pytest.raises(TypeError, match="the address of a Material is wanted"):
        _density(body.address)


def test_zeros_have_the_extents_asked_for() -> None:
    body = Body.zeros(n=5, m=1, material=Material.zeros(), triangles=np.full((1, 3), 2, np.int32))
    assert (body.position.shape, body.frame.shape, body.tick) == ((5, 3), (5, 3, 3), 0)
    assert (body.triangles == 2).all()
    assert body.material.is_soft is False
    with pytest.raises(TypeError, match=r"Body.triangles: extent 'm' is missing"):
        Body.zeros(n=5, material=Material.zeros())
    with pytest.raises(TypeError, match=r"Body.k: no such field"):
        Body.zeros(n=5, m=1, k=2, material=Material.zeros())


def test_a_struct_is_neither_copied_nor_pickled() -> None:
    material = Material(density=1.0, is_soft=True)
    for attempt in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="a Material holds addresses"):
            attempt(material)


def test_no_kernel_counts_references() -> None:
    body = Body(**_values())
    before = sys.getrefcount(body.position)
    _write(body.address, 0)
    after = sys.getrefcount(body.position)
    assert after == before


def test_a_kernel_may_be_called_with_the_struct_itself_outside_the_tick() -> None:
    body = Body(**_values())
    assert _of(body, 2) == 7.0


@kernel
def _of(body: Body, node: int) -> float:
    return body.position[node, 1]


def test_bounds_are_checked_where_numba_is_told_to() -> None:
    code = "import test_struct as t; body = t.Body(**t._values()); t._read(body.address, {})"
    folder = os.path.dirname(__file__)
    for node, fails in ((4, True), (3, False)):
        done = subprocess.run(
            [sys.executable, "-c", code.format(node)],
            env={**os.environ, "NUMBA_BOUNDSCHECK": "1", "PYTHONPATH": os.getcwd()},
            cwd=folder,
            capture_output=True,
            text=True,
        )
        assert ("IndexError: index is out of bounds" in done.stderr, done.returncode) == (fails, fails)


def test_the_example_of_the_documentation_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[3] / "docs" / "reference" / "kernels.md").read_text()
    before = "import numpy as np\npositions, springs = np.eye(3), np.array([[0, 1]], np.int32)\n"
    (tmp_path / "chain_of_the_page.py").write_text(before + page.split("```python\n")[1].split("```")[0])
    monkeypatch.syspath_prepend(tmp_path)
    example = importlib.import_module("chain_of_the_page")
    assert example.chain.steps == 1
    assert example.longest_spring(example.chain.address) == 2.0**0.5
