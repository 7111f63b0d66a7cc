"""The cubic part of the energy against the energy itself, and against what a rotation of everything must leave out."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.fem.nonlinear import Configuration, CorotationalShell
from trocar.services.mechanics.fem.nonlinear.cubic_energy import cubic_tensor_and_energies
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct


@pytest.fixture(scope="module", params=["cst", "andes"])
def shell(request):
    mesh = parametric_duct(DuctGeometry(4e-3, 20e-3, 10, 8))
    section = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
    return CorotationalShell(ShellModel(mesh, section, [clamp(mesh)], ElementChoice(request.param, "dkt")))


def responses(shell, n):
    """Linear responses (6 n, k) to random forces, each of at most a millimetre."""
    model, random = shell.model, np.random.default_rng(3)
    loads = random.standard_normal((len(model.free_dofs), n))
    loads[model.free_dofs % 6 >= 3] = 0.0
    fields = np.zeros((model.n_dofs, n))
    fields[model.free_dofs] = model.factor.solve(loads)
    return 1e-3 * fields / np.abs(fields.reshape(-1, 6, n)[:, :3]).max(axis=(0, 1))


def cubic_tensor(shell, fields):
    return cubic_tensor_and_energies(shell, fields, fields[:, :0])[0]


def test_cubic_energy_is_the_third_derivative(shell):
    """The odd part of the energy along a field tends to T x x x / 6; beside it only fifth order is left."""
    fields = responses(shell, 2)
    x = np.array([0.8, -0.6])
    along, cubic = fields @ x, np.einsum("abc,a,b,c", cubic_tensor(shell, fields).astype(float), x, x, x) / 6.0
    rest = Configuration.undeformed(shell.model)

    def odd(step):
        there, back = shell.energy_j(rest.moved(step * along)), shell.energy_j(rest.moved(-step * along))
        return (there - back) / (2.0 * step**3)

    assert odd(0.05) == pytest.approx(cubic, rel=1e-4)
    assert abs(odd(1.0) / cubic - 1.0) > 1e-5


def test_energies_of_fields_alone_are_those_of_the_tensor(shell):
    fields = responses(shell, 5)
    T, energies = cubic_tensor_and_energies(shell, fields[:, :2], fields[:, 2:])
    np.testing.assert_array_equal(T, cubic_tensor(shell, fields[:, :2]))
    own = np.einsum("aaa->a", cubic_tensor(shell, fields[:, 2:])) / 6.0
    np.testing.assert_allclose(energies, own, rtol=1e-4)


def test_it_is_symmetric(shell):
    T = cubic_tensor(shell, responses(shell, 4))
    for turned in (T.transpose(1, 0, 2), T.transpose(2, 1, 0), T.transpose(0, 2, 1)):
        np.testing.assert_allclose(turned, T, atol=2e-5 * np.abs(T).max())


def test_a_turn_of_everything_has_no_energy_of_third_order_with_a_response(shell):
    """E of a field seen from a turned frame is the same: T(r, u, u) makes up for what K misses of the turned field."""
    n = shell.model.mesh.n_vertices
    turn = np.array([0.3, -0.5, 0.4])
    rigid = np.concatenate([np.cross(turn, shell.model.mesh.vertices_m), np.broadcast_to(turn, (n, 3))], axis=1).ravel()
    u = responses(shell, 1)[:, 0]
    K = shell.model.K_full
    spun = np.concatenate([np.cross(turn, u.reshape(-1, 6)[:, 3 * k : 3 * k + 3]) for k in (0, 1)], axis=1)
    # d/de of E(e r + (1 + e turn) u) is zero: T(r, u, u) / 2 = -u K (turn x u); half of the turn of rotation vectors
    # is in their composition.
    spun[:, 3:] *= 0.5
    T = cubic_tensor(shell, np.stack([rigid, u], axis=1)).astype(float)
    assert 0.5 * T[0, 1, 1] == pytest.approx(-float(u @ (K @ spun.ravel())), rel=1e-3)
