"""What names a contact from tick to tick: bit fields that hold all they must and do not touch each other."""

from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.contact.identity import (
    LAW,
    PARTICLE,
    SEGMENT,
    TARGET,
    TARGET_KIND,
    TOOL,
    hold_identity,
    pair_identity,
    part_of,
    with_law,
    without_target,
)

PAIRS = st.tuples(
    st.integers(NO_TOOL, TOOL.size - 2),
    st.integers(0, SEGMENT.size - 1),
    st.integers(-1, PARTICLE.size - 2),
    st.integers(0, TARGET_KIND.size - 1),
    st.integers(0, TARGET.size - 1),
)
LAWS = st.integers(0, LAW.size - 1)


def mask(field):
    return (field.size - 1) << field.shift


def test_fields_do_not_overlap_and_leave_the_sign():
    taken = 0
    for field in (TARGET, TARGET_KIND, PARTICLE, SEGMENT, TOOL, LAW):
        assert taken & mask(field) == 0
        taken |= mask(field)
    assert taken < 1 << 63


@settings(deadline=None)  # the first example compiles
@given(PAIRS, LAWS)
def test_every_part_is_found_again(pair, law):
    identity = with_law(pair_identity(*pair), law)
    parts = [part_of(identity, field) for field in (TOOL, SEGMENT, PARTICLE, TARGET_KIND, TARGET)]
    assert parts == [pair[0] + 1, pair[1], pair[2] + 1, pair[3], pair[4]]
    assert part_of(identity, LAW) == law


@settings(deadline=None)  # the first example compiles
@given(PAIRS, PAIRS)
def test_without_its_target_a_pair_is_named_by_first_body_and_kind_of_target(one, other):
    same = without_target(pair_identity(*one)) == without_target(pair_identity(*other))
    assert same == (one[:4] == other[:4])


@settings(deadline=None)  # the first example compiles
@given(PAIRS, st.integers(0, 2**38), st.integers(0, 2**38))
def test_holds_are_no_pairs_and_each_its_own(pair, one, other):
    assert hold_identity(one) < 0 <= pair_identity(*pair)
    assert (without_target(hold_identity(one)) == without_target(hold_identity(other))) == (one == other)
