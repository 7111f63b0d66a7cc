"""When a contact counts as sliding: it has slid by some way, with most of the pressure between its two bodies."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.identity import pair_identity
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.sliding import SLID_M, begin_slides, store_slides
from trocar.services.mechanics.contact.warm_start import ForceMemory
from trocar.services.mechanics.contact.writer import append_row

N = 4


class Contacts:
    """The catheter on the wall by four contacts that are pressed alike, step after step."""

    def __init__(self):
        self.rows, self.memory = ContactRows.zeros(c=N), ForceMemory.zeros(c=N)
        self.problem = ContactProblem.of(self.rows)

    def step(self, slips_m, known=N, pressed_n=(1.0,) * N):
        """Slide each contact by so much, where it is not zero; the memory knows the first of them."""
        self.rows.n_contacts = 0
        for row, slip_m in enumerate(slips_m):
            append_row(self.rows, number_of("unilateral"), pair_identity(-1, 0, row, 0, row))
            if row < known:
                self.rows.slid_m[row] = self.memory.slid_m[row]
            self.rows.friction[row], self.rows.force_n[row, 0] = 0.3, pressed_n[row]
            self.problem.motion[3 * row + 1] = slip_m
        begin_slides(self.memory, self.rows, 0)
        began = self.rows.slid_m[: len(slips_m)] >= SLID_M
        store_slides(self.memory, self.problem, np.array([slip_m != 0.0 for slip_m in slips_m]))
        return began.tolist()


def slides(contacts, **more):
    """Whether each contact has the kinetic coefficient in a step in which all slide on a little."""
    return contacts.step([1e-6] * N, **more)


def test_contacts_that_strain_each_other_stay_static():
    contacts = Contacts()
    for _ in range(10):
        contacts.step([2e-6, 0.0, -2e-6, 0.0])
    assert slides(contacts) == [False] * N


def test_bodies_that_have_slid_by_a_way_slide_whatever_the_step():
    for parts in (2, 100):
        contacts = Contacts()
        for _ in range(parts):
            assert contacts.step([1.01 * SLID_M / parts] * N) == [False] * N
        assert slides(contacts) == [True] * N


def test_what_comes_anew_between_bodies_that_slide_slides_too():
    contacts = Contacts()
    contacts.step([1.1 * SLID_M] * N)
    assert slides(contacts, known=1) == [True] * N
    assert slides(Contacts(), known=0) == [False] * N


def test_a_contact_that_a_bump_stops_for_a_moment_goes_on_sliding():
    contacts = Contacts()
    contacts.step([1.1 * SLID_M] * N)
    contacts.step([1e-6, 1e-6, 1e-6, 0.0])
    assert slides(contacts) == [True] * N


def test_most_of_the_pressure_decides_not_most_of_the_contacts():
    contacts = Contacts()
    contacts.step([1.1 * SLID_M] * N)
    contacts.step([1e-6, 0.0, 0.0, 0.0], pressed_n=(4.0, 1.0, 1.0, 1.0))
    assert slides(contacts) == [True] * N
    contacts.step([1e-6, 0.0, 0.0, 0.0], pressed_n=(2.0, 1.0, 1.0, 1.0))
    assert slides(contacts) == [True, False, False, False]


@pytest.mark.parametrize("rest_m", [0.0, 1e-9])
def test_bodies_that_rest_stick_again_even_on_their_cones(rest_m):
    contacts = Contacts()
    contacts.step([1.1 * SLID_M] * N)
    contacts.step([rest_m] * N)
    assert slides(contacts) == [False] * N


def test_bodies_that_do_not_touch_slide_on_nothing():
    contacts = Contacts()
    contacts.step([1.1 * SLID_M] * N)
    contacts.step([0.0] * N, pressed_n=(0.0,) * N)
    assert slides(contacts, known=0) == [False] * N
