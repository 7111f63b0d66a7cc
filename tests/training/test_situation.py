"""What is read off frames, against brute force and figures that one can draw."""

from __future__ import annotations

import math
import warnings

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.by_day import examples
from tests.protocol import strategies
from tests.training.streams import CLIPPED_SITE, GOOD, SCENARIO, SITE, Channel, changed, messages
from tests.training.test_errors import judged, pulse
from trocar.protocol import TOPICS
from trocar.protocol.arrays import pack
from trocar.protocol.bodies import GatewayState, HeldPoint, PhysicsState
from trocar.protocol.bodies.physics import REACTION_GRASP_TORQUE
from trocar.review.attempts.trace import Trace
from trocar.services.training.judge import Judge
from trocar.services.training.procedure import PHASES, Procedure
from trocar.services.training.site import Site
from trocar.services.training.situation import Loads, Situation, SituationReader, segments_apart_m


def test_loads_in_a_line_have_two_sides() -> None:
    force = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [9.0, 9.0, 9.0]])
    loads = Loads(force)
    of = np.array([True, True, False])
    assert loads.sides(of) == pytest.approx((3.0, 1.0))
    assert loads.net(of) == pytest.approx(2.0)


def test_the_distance_of_segments_is_that_of_their_closest_points() -> None:
    chance, steps = np.random.default_rng(8), np.linspace(0.0, 1.0, 201)
    for _ in range(100):
        a, b, c, d = chance.standard_normal((4, 3))
        one, other = a + np.outer(steps, b - a), c + np.outer(steps, d - c)
        brute = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        assert brute - 0.02 <= segments_apart_m(a, b, c, d) <= brute + 1e-12
    a = np.zeros(3)
    assert segments_apart_m(a, a, np.array([1.0, 0, 0]), np.array([1.0, 2, 0])) == pytest.approx(1.0)


def seen(changes: dict[str, Channel], seconds: float) -> Situation:
    """The last situation of an attempt."""
    observer, last = SituationReader(SITE), None
    for topic, _, body in messages(changed(changes), seconds):
        last = observer.take_body(topic, body) or last
    assert last is not None
    return last


@pytest.mark.parametrize(
    ("torque_nm", "away_m", "kind", "grips"),
    [(5e-3, 0.0, 0, True), (0.0, 0.0, 0, False), (-5e-3, 0.0, 0, False), (5e-3, 0.02, 0, False), (5e-3, 0.0, 2, False)],
    ids=["squeezed", "touched", "pushed shut", "pressed elsewhere", "catheter at the wall"],
)
def test_jaws_grip_the_duct_where_it_keeps_them_open(torque_nm: float, away_m: float, kind: int, grips: bool) -> None:
    observer, situation = SituationReader(None), None
    for topic, _, body in messages(changed({"grip": [(0.0, 1.0)], "hold": [(0.0, 0.0)]}), 0.02):
        if isinstance(body, PhysicsState):
            table = body.tools.view().copy()
            table[1, REACTION_GRASP_TORQUE] = torque_nm
            contacts = msgspec.structs.replace(
                body.contacts,
                kind=pack([kind], "|i1"),
                point_m=pack(body.contacts.point_m.view()[:1] + np.array([0.0, away_m, 0.0])),
                force_n=pack([[0.0, 0.0, 1.0]]),
            )
            body = msgspec.structs.replace(body, tools=pack(table), contacts=contacts)
        situation = observer.take_body(topic, body) or situation
    assert situation is not None
    assert [hand.grips_duct for hand in situation.hands] == [False, grips]


def test_an_arc_of_a_circle_has_its_radius() -> None:
    assert seen({"bend": [(0.0, 100.0)]}, 1.0).bend_radius_m == pytest.approx(10e-3, rel=1e-6)


def test_depth_and_distance_are_those_of_the_catheter() -> None:
    assert seen({}, 1.0).to_mouth_m == pytest.approx(6e-3)
    inside = seen({}, 6.0)
    assert inside.to_mouth_m == pytest.approx(inside.inserted_m)
    assert inside.advance_m_s == pytest.approx(15e-3 / 5.5)
    assert inside.direction_cosine == pytest.approx(1.0)


def test_the_opening_grows_with_the_square_of_its_radius() -> None:
    assert seen({"opening": [(0.0, 1.21)]}, 1.0).rim_opening == pytest.approx(1.21)


def test_a_hand_that_steadies_the_mouth_from_the_beginning_secures_nothing() -> None:
    judge, _ = judged({"grip": GOOD["grip"][:2], "clip": [(0.3, 0.5)]}, 9.0)
    assert judge.procedure.phase == "P4"


CLIPPED: dict[str, Channel] = {
    "grip": [*GOOD["grip"][:-2], (9.199, 0.0), (9.2, 1.0), (9.799, 1.0), (9.8, 0.0)],
    "clipped": [(9.3, 0.0), (9.5, 0.6)],
}


@pytest.mark.parametrize(("site", "phase"), [(CLIPPED_SITE, "P5"), (SITE, "P4")])
def test_a_clip_holds_on_when_the_jaws_that_closed_it_have_let_go(site: Site, phase: str) -> None:
    """And where there is none, a wall that presses from both sides is no clip."""
    judge = Judge(SCENARIO, site)
    for message in messages(changed(CLIPPED), 11.0):
        judge.take_frame(*message)
    assert judge.procedure.phase == phase


@pytest.mark.parametrize(("pressed_n", "codes"), [(0.6, set()), (0.2, {"E9", "E10"}), (1.8, {"E9"})])
def test_what_a_clip_presses_with_tells_whether_it_is_loose_or_crimps_or_leaks(
    pressed_n: float, codes: set[str]
) -> None:
    judge = Judge(SCENARIO, CLIPPED_SITE)
    for message in messages(changed(CLIPPED | {"clipped": [(9.3, 0.0), (9.5, pressed_n)]}), 13.9):
        judge.take_frame(*message)
    assert judge.procedure.order[-2:] == ("P5", "P6")
    assert set(judge.errors) & {"E9", "E10"} == codes


def test_a_pull_at_a_catheter_under_a_clip_is_no_pressure_less() -> None:
    reader, last = SituationReader(CLIPPED_SITE), None
    for topic, _, body in messages(changed(CLIPPED | {"clip_drags": [(0.0, 0.3)]}), 11.0):
        last = reader.take_body(topic, body) or last
    assert last is not None
    assert last.clipped_n == pytest.approx(0.6, rel=1e-9)


def test_a_way_back_far_from_the_mouth_is_no_retry() -> None:
    far = [(1.0, 4.5e-3), (1.5, 4.5e-3), (1.8, 9e-3), (2.1, 4.5e-3), (2.4, 4.4e-3)]
    judge, errors = judged({"gap": far}, 2.5)
    assert judge.procedure.phase == "P3"
    assert (judge.procedure.retries, errors) == (0, [])


def test_an_error_that_pauses_for_a_moment_is_one() -> None:
    one, other = (pulse("traction", 3.0, 0.3, at_s)["traction"] for at_s in (4.0, 4.32))
    both = sorted(set(one) | set(other))
    assert len(judged({"traction": both}, 5.0)[1]) == 1
    apart = sorted(set(one) | set(pulse("traction", 3.0, 0.3, 4.4)["traction"]))
    assert len(judged({"traction": apart}, 5.0)[1]) == 2


def test_catheter_pulled_out_of_an_open_mouth_goes_back_to_the_approach() -> None:
    judge, _ = judged({"inserted": [(2.5, 0.0), (5.0, 8e-3), (6.0, 0.0), (6.5, 0.0), (8.0, 8e-3)]}, 8.5)
    phases = [span.phase for span in judge.procedure.spans]
    assert phases == ["P0", "P1", "P2", "P3", "P4", "P3", "P4"]
    assert judge.procedure.retries == 1


def test_live_judge_tells_phase_and_counts() -> None:
    judge = Judge(SCENARIO, SITE)
    for message in messages(changed(pulse("traction", 3.0, 0.3)), 5.0):
        judge.take_frame(*message)
    assert (judge.phase, judge.errors) == ("P4", {"E1": 1})


def test_time_is_that_of_ticks() -> None:
    procedure = Procedure(SCENARIO)
    observer = SituationReader(SITE)
    for topic, _, body in messages(GOOD, 1.0, first_tick=123_456):
        situation = observer.take_body(topic, body)
        if situation is not None:
            procedure.take_situation(situation)
    assert procedure.time_s == pytest.approx(0.98)
    assert math.isfinite(procedure.spans[-1].end_s)


def test_a_strange_peer_changes_nothing() -> None:
    """A clock that goes back, a catheter of one particle, holds of tools and segments that are not there."""
    judge = Judge(SCENARIO, SITE)
    for message in messages(GOOD, 1.0):
        judge.take_frame(*message)
    (_, _, gateway), (_, _, contacts), (_, _, state) = messages(GOOD, 0.02, first_tick=3000)
    one = pack(np.zeros((1, 3)))
    strange = [
        msgspec.structs.replace(state, tick=5),
        msgspec.structs.replace(state, catheter=msgspec.structs.replace(state.catheter, position_m=one)),
    ]
    assert [judge.take_frame("physics.state", 0, body) for body in strange] == [None, None]
    far = hold(tool=7, target=3), hold(tool=0, target=10**6)
    for body in (msgspec.structs.replace(contacts, holds=far), gateway, msgspec.structs.replace(state, tick=4000)):
        judge.take_frame("any", 0, body)
    assert judge.procedure.time_s == pytest.approx(3.0)
    assert set(judge.errors) == {"E13"}  # what was held is not any more


def hold(**said: int) -> HeldPoint:
    weights = (1.0, 0.0, 0.0)
    return HeldPoint(hold_id=1, target_kind=1, target_weights=weights, limit_n=1.0, jaw_angle_rad=0.1, **said)


@settings(max_examples=examples(15, 200), deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_no_sound_frame_ends_a_judge(data: st.DataObject) -> None:
    judge = Judge(SCENARIO, data.draw(st.sampled_from([SITE, None])))
    trace = Trace()
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for name in ("gateway.state", "haptics.contacts", "physics.state", "physics.state"):
            body = data.draw(strategies.bodies(TOPICS[name].body))
            if isinstance(body, GatewayState):
                trace.take_devices(body)
            situation = judge.take_frame(name, 0, body)
            if situation is not None:
                trace.take_situation(situation, judge.procedure)
        judge.finish()
        assert judge.phase in PHASES
