"""The same mesh in OpenSeesPy, an independent solver: frequencies and point-load displacements to compare with."""

from __future__ import annotations

import ctypes
import importlib
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel

# In loading order; the wheel ships them beside the module but does not always point the loader at them.
BUNDLED_LIBRARIES = ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3")


def load_opensees() -> Any:
    """Import OpenSeesPy. Raises ImportError if it is not installed or its libraries do not load."""
    bundled = Path(sysconfig.get_paths()["purelib"]) / "openseespylinux" / "lib"
    try:
        for name in BUNDLED_LIBRARIES:
            if (bundled / name).exists():
                ctypes.CDLL(str(bundled / name), mode=ctypes.RTLD_GLOBAL)
        return importlib.import_module("openseespy.opensees")
    except (ImportError, OSError, RuntimeError) as error:
        raise ImportError(f"OpenSeesPy does not load: {error}") from error


def opensees_frequencies_hz(model: ShellModel, clamped: IntArray, n_modes: int) -> FloatArray:
    """(n_modes,) frequencies of `ShellDKGT` triangles on the model's mesh, ``clamped`` nodes held."""
    ops = _build(model, clamped)
    frequencies: FloatArray = np.sqrt(np.array(ops.eigen(n_modes))) / (2.0 * np.pi)
    ops.wipe()
    return frequencies


def opensees_displacement_m(model: ShellModel, clamped: IntArray, load: FloatArray) -> FloatArray:
    """(n, 3) static displacement of the same shell under (n, 3) nodal forces."""
    ops = _build(model, clamped)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for node in np.flatnonzero(np.abs(load).max(axis=1)).tolist():
        ops.load(node + 1, *load[node].tolist(), 0.0, 0.0, 0.0)
    ops.system("SparseSYM")
    ops.numberer("RCM")
    ops.constraints("Plain")
    ops.integrator("LoadControl", 1.0)
    ops.algorithm("Linear")
    ops.analysis("Static")
    if ops.analyze(1) != 0:
        raise RuntimeError("OpenSees did not solve the static problem")
    nodes = range(1, model.mesh.n_vertices + 1)
    displacement = np.array([[ops.nodeDisp(node, k) for k in (1, 2, 3)] for node in nodes])
    ops.wipe()
    return displacement


def _build(model: ShellModel, clamped: IntArray) -> Any:
    """Fill OpenSees' one global model; only a uniform isotropic section is supported."""
    ops = load_opensees()
    section = model.section
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for tag, xyz in enumerate(model.mesh.vertices_m.tolist(), 1):
        ops.node(tag, *xyz)
    ops.section(
        "ElasticMembranePlateSection",
        1,
        section.youngs_modulus_pa,
        section.poisson_ratio,
        section.thickness_m,
        section.density_kg_m3,
    )
    for tag, nodes in enumerate((model.mesh.triangles + 1).tolist(), 1):
        ops.element("ShellDKGT", tag, *nodes, 1)
    for node in (np.asarray(clamped) + 1).tolist():
        ops.fix(node, 1, 1, 1, 1, 1, 1)
    return ops
