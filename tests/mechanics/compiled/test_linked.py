"""Of kernels that only kernels call small ones are linked, large ones called: alike from memory and from disk."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from llvmlite import binding as llvm
from numba import njit, types

from services.mechanics.compiled import building_kernel, callback, kernel, summing_kernel

ROOT = Path(__file__).parents[3]
CALL = """
from numba.core import codegen, event
{before}
from tests.mechanics.compiled.test_linked import {name}

with event.install_recorder("numba:compile") as compiled:
    print({name}(16.0))
    try:
        {name}(-1.0)
    except ValueError as error:
        print(error)
print(sum(each.is_start for _, each in compiled.buffer))
"""


@kernel
def root_of(x: float) -> float:
    """Is called by kernels, here never by Python."""
    if x < 0.0:
        raise ValueError("below zero")
    return x**0.5


@kernel
def half_root_of(x: float) -> float:
    """Return half of it."""
    return 0.5 * root_of(x)


@kernel
def quarter_root_of(x: float) -> float:
    """Return a quarter of it, through the half."""
    return 0.5 * half_root_of(x)


@kernel
def twice_root_of(x: float) -> float:
    """Return twice of it."""
    return 2.0 * root_of(x)


@building_kernel
def filled_roots(x: float) -> float:
    """Return it through an array, which is allocated."""
    return float(np.full(3, root_of(x))[1])


@njit(cache=True)  # type: ignore[untyped-decorator]  # numba has no types
def usual_root(x: float) -> float:
    """Return it by a function that knows nothing of kernels."""
    root: float = root_of(x)
    return root


@summing_kernel
def triangle_of(x: float) -> float:
    """Return a sum that an optimiser takes several terms at once of: 0 + 1 + ... + x - 1."""
    total = 0.0
    for k in range(int(x)):
        total += float(k)
    return total


@kernel
def half_triangle_of(x: float) -> float:
    """Return half of it."""
    return 0.5 * triangle_of(x)


def _call(name: str, kernels: Path, before: str = "") -> list[str]:
    """Return what a kernel says in another process: its value, its error, and how many kernels were compiled for it."""
    return _run(CALL.format(name=name, before=before), kernels)


def _run(program: str, kernels: Path) -> list[str]:
    """Return the lines that a program says which keeps its kernels in a folder."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


#: What another numba may lack, by what is done to this one.
OTHER_NUMBAS = {
    "no such class": "del codegen.JITCodeLibrary",
    "a library is made in another way": """
class Library(codegen.JITCodeLibrary):
    def __init__(self, codegen, name, more):
        super().__init__(codegen, name)
codegen.JITCodeLibrary = Library
""",
    "a part of a library is missing": """
from services.mechanics.compiled import linked
def missing(codegen, *_):
    return codegen.no_such_part
linked._stub = missing
""",
}


def _machine_code_bytes(kernels: Path, name: str) -> int:
    (file,) = kernels.glob(f"*/test_linked.{name}-*.nbc")
    (_, kind, (machine_code, _)), *_ = pickle.loads(file.read_bytes())
    assert kind == "object"
    return sum(each.size() for each in llvm.ObjectFileRef.from_data(machine_code).sections() if each.is_text())


def _vectors(kernels: Path, name: str) -> bool:
    """Whether a kernel's code for callers computes with several numbers at once."""
    (file,) = kernels.glob(f"*/test_linked.{name}-*.nbc")
    (_, _, (_, for_callers)), *_ = pickle.loads(file.read_bytes())
    return "x double>" in str(llvm.parse_bitcode(for_callers))


@pytest.mark.parametrize("optimised", [False, True])
def test_what_kernels_call_is_optimised_in_its_callers_and_alone_only_where_detection_is(
    optimised: bool, tmp_path: Path
) -> None:
    here = "import services.mechanics.compiled as c; c._OPTIMISED_BY_THEMSELVES = ('tests.',)" if optimised else ""
    assert _call("half_triangle_of", tmp_path, here)[0] == "60.0"
    assert _vectors(tmp_path, "triangle_of.within_kernels") == optimised
    assert _vectors(tmp_path, "half_triangle_of")


#: Says of each kernel that only kernels call which functions are optimised in its turn.
TELLING = """
import services.mechanics.compiled as compiled
from services.mechanics.compiled import linked
compiled._OPTIMISED_BY_THEMSELVES = ("tests.",)
linked._INLINED = {instructions}
optimise = linked._LinkedLibrary._optimise
def telling(library):
    defined = [each.name for each in library._final_module.functions if not each.is_declaration]
    print("optimised:", *sorted(kernel for kernel in ("half", "root") if any("11test_linked" in name and
        ("12half_root_of" if kernel == "half" else "7root_of") in name for name in defined)))
    optimise(library)
linked._LinkedLibrary._optimise = telling
"""


@pytest.mark.parametrize(("instructions", "with_half"), [(0, "half"), (1000, "half root")])
def test_what_is_too_large_to_be_inlined_is_optimised_in_its_own_turn_only(
    instructions: int, with_half: str, tmp_path: Path
) -> None:
    said = _call("quarter_root_of", tmp_path, TELLING.format(instructions=instructions))
    assert said == ["optimised: root", f"optimised: {with_half}", "1.0", "below zero", "3"]
    assert _call("quarter_root_of", tmp_path) == ["1.0", "below zero", "0"], "all of it was linked and kept"


#: Makes a kernel of any size large.
ALL_LARGE = "from services.mechanics.compiled import linked; linked._INLINED = 0"


def _has_root(kernels: Path, name: str) -> bool:
    """Return whether a kernel's own machine code has the root's in it: with it comes what the root raises."""
    (file,) = kernels.glob(f"*/test_linked.{name}-*.nbc")
    (_, _, (machine_code, _)), *_ = pickle.loads(file.read_bytes())
    return b"below zero" in machine_code


def test_what_is_large_is_machine_code_beside_its_callers_and_in_none_of_them(tmp_path: Path) -> None:
    right = ["1.0", "below zero"]
    assert _call("quarter_root_of", tmp_path, ALL_LARGE) == [*right, "3"]
    assert not _has_root(tmp_path, "quarter_root_of")
    assert not _has_root(tmp_path, "half_root_of.within_kernels")
    assert _call("quarter_root_of", tmp_path) == [*right, "0"], "read from disk, first what is called last"
    assert _call("twice_root_of", tmp_path, ALL_LARGE) == ["8.0", "below zero", "1"], "calls what another has compiled"
    assert _call("twice_root_of", tmp_path) == ["8.0", "below zero", "0"]


#: Calls two kernels that call the same third, and says how often machine code was read.
BOTH = """
from services.mechanics.compiled import apart
from tests.mechanics.compiled.test_linked import half_root_of, twice_root_of
print(half_root_of(16.0), twice_root_of(16.0), len(apart._HERE))
"""


def test_a_process_reads_the_machine_code_of_two_callers_once(tmp_path: Path) -> None:
    assert _call("half_root_of", tmp_path, ALL_LARGE + BOTH) == ["2.0 8.0 1", "2.0", "below zero", "0"]
    assert _call("half_root_of", tmp_path, BOTH) == ["2.0 8.0 1", "2.0", "below zero", "0"]


@pytest.mark.parametrize("name", ["filled_roots", "usual_root"])
def test_what_is_compiled_as_usual_calls_machine_code_too(name: str, tmp_path: Path) -> None:
    assert _call(name, tmp_path, ALL_LARGE)[:2] == ["4.0", "below zero"]
    assert _call(name, tmp_path) == ["4.0", "below zero", "0"]


#: Has C call a callback of ours, and says how often machine code was read.
CALL_BACK = """
import ctypes
{before}
from services.mechanics.compiled import apart
from tests.mechanics.compiled.test_linked import root_for_c
made = root_for_c()
print(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(made.address)(16.0), made.cache_hits, len(apart._HERE))
"""


def plain_root(x: float) -> float:
    """Return it by what C can call."""
    return root_of(x)


def root_for_c() -> Any:
    """Return the callback."""
    return callback(types.float64(types.float64), plain_root)


def test_a_callback_that_is_read_from_disk_finds_the_machine_code_that_it_calls(tmp_path: Path) -> None:
    assert _run(CALL_BACK.format(before=ALL_LARGE), tmp_path) == ["4.0 0 1"]
    assert _run(CALL_BACK.format(before=""), tmp_path) == ["4.0 1 1"]


def test_what_copies_of_one_process_have_compiled_is_read_by_a_third(tmp_path: Path) -> None:
    copies = f"""
{ALL_LARGE}
import os
from numba import types
from tests.mechanics.compiled.test_linked import half_root_of, root_of, twice_root_of
root_of.get_call_template((types.float64,), {{}})
for each in half_root_of, twice_root_of:
    if (born := os.fork()) == 0:
        each(16.0)
        os._exit(0)
    assert os.waitpid(born, 0)[1] == 0
"""
    _run(copies, tmp_path)
    both = "from tests.mechanics.compiled.test_linked import half_root_of, twice_root_of; "
    assert _run(both + "print(half_root_of(16.0), twice_root_of(16.0))", tmp_path) == ["2.0 8.0"]
    assert _call("half_root_of", tmp_path)[-1] == "0"


def test_nothing_else_is_compiled_by_numba_in_a_way_that_forgets_machine_code() -> None:
    """Of what its decorators keep on disk only that of kernels, and of our callbacks, names what it calls."""
    of_numba = re.compile(r"\b(?:njit|jit|cfunc|vectorize|guvectorize)\b.*\(")
    ours = ROOT / "services" / "mechanics" / "compiled"
    others = (path for path in (ROOT / "services").rglob("*.py") if ours not in path.parents)
    assert [path for path in others if of_numba.search(path.read_text())] == []


def test_what_kernels_call_is_compiled_once_and_is_machine_code_in_its_callers_only(tmp_path: Path) -> None:
    assert _call("half_root_of", tmp_path) == ["2.0", "below zero", "2"]
    assert _has_root(tmp_path, "half_root_of"), "one that is small is linked"
    assert _machine_code_bytes(tmp_path, "root_of.within_kernels") == 0
    assert _call("half_root_of", tmp_path) == ["2.0", "below zero", "0"]
    assert _call("twice_root_of", tmp_path) == ["8.0", "below zero", "1"], "the root is linked from disk"


@pytest.mark.parametrize("before", OTHER_NUMBAS.values(), ids=OTHER_NUMBAS.keys())
def test_with_another_numba_all_have_machine_code_and_do_the_same(before: str, tmp_path: Path) -> None:
    assert _call("half_root_of", tmp_path, before) == ["2.0", "below zero", "2"]
    assert _machine_code_bytes(tmp_path, "root_of.within_kernels") > 0
    assert _call("twice_root_of", tmp_path) == ["8.0", "below zero", "1"], "the root is linked from disk"
