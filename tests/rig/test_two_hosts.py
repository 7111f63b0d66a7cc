"""One rig on hosts whose uptimes differ by hours: what is felt, refused and shown, by the road between them."""

from __future__ import annotations

import statistics
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest
from websockets.sync.client import ClientConnection, connect

from tests.patience import PATIENCE_S
from tests.rig.faults import force_n, force_rates_n_s, rate_limit_n_s
from tests.rig.two_hosts import AHEAD_S, FarRig, Hosts, address, may_be_had

pytestmark = [pytest.mark.rig, pytest.mark.timeout(900), pytest.mark.skipif(bool(may_be_had()), reason=may_be_had())]

WHERE = {"haptics": 0, "gateway": 0, "physics": 1, "supervisor": 1, "visualization": 2}
FAR_MS = 20.0
LIMP = "no force: what haptics hears of physics is too old"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FarRig]:
    folder = tmp_path_factory.mktemp("hosts")
    with ExitStack() as stack:
        hosts = stack.enter_context(Hosts(folder, 3))
        view = [f"visualization.host={address(2)}", "visualization.port=8081", "supervisor.web.insecure=true"]
        rig = stack.enter_context(closing(FarRig(folder, hosts, WHERE, view)))
        rig.until_it_runs()
        yield rig


def _feels(rig: FarRig) -> None:
    rig.hosts.set(0.0)
    rig.observer.samples.clear()
    rig.observer.until(
        lambda: bool(rig.observer.samples) and force_n(rig.observer.samples[-1]) > 0.02, PATIENCE_S, "a force"
    )


def test_hosts_that_are_hours_apart_run_one_rig(rig: FarRig) -> None:
    """By its own clock physics was an hour ahead: its word was never stale, or always."""
    _feels(rig)
    for name, publisher, ahead_s in (
        ("haptics", "physics", AHEAD_S[1]), ("physics", "haptics", -AHEAD_S[1]),
        ("visualization", "physics", AHEAD_S[1] - AHEAD_S[2]), ("gateway", "visualization", AHEAD_S[2]),
    ):  # fmt: skip
        gauges = rig.health_of(name).gauges
        off_s = gauges[f"clock_off_s.{publisher}"]
        assert abs(gauges[f"clock_ahead_s.{publisher}"] - ahead_s) <= off_s < 0.1
    assert "clock_ahead_s.haptics" not in rig.health_of("gateway").gauges, "it is on the same host"


def test_a_third_host_shows_the_picture_and_knows_how_old_it_is(rig: FarRig) -> None:
    """Dated by the devices' host, a picture was two hours from the future."""
    _feels(rig)
    rig.hosts.set(5.0, 1.0, 0.01)
    with rig.hosts.inside(0), connect(f"ws://{address(2)}:8081/ws", compression=None) as client:
        seen, end_s = [_picture(client)], time.monotonic() + PATIENCE_S
        # A lost packet is sent again after 0.2 s, twice lost 0.4. Some pictures show nothing new, and have no age.
        while len(seen) < 20 or seen[-1][0] <= seen[0][0] or not any(age_s for _, age_s in seen):
            assert time.monotonic() < end_s, "the picture does not advance"
            seen.append(_picture(client))
    assert 0.005 < statistics.median(age_s for _, age_s in seen if age_s) < 1.0


def _picture(client: ClientConnection) -> tuple[int, float]:
    """Return the tick of the next picture, and the age of what it shows when it was sent, 0 for nothing new."""
    while True:
        message = client.recv(timeout=PATIENCE_S)
        if isinstance(message, bytes):
            sequence, sent_ns, origin_ns, tick = struct.unpack_from("<4Q", message)
            client.send(struct.pack("<Q", sequence))
            return tick, 1e-9 * (sent_ns - origin_ns) if origin_ns else 0.0


def test_too_far_away_the_arm_is_limp_without_a_kick_and_that_is_said(rig: FarRig) -> None:
    _feels(rig)
    observer = rig.observer
    refused = rig.health_of("gateway").gauges["models_invalid"]
    rig.hosts.set(FAR_MS)
    observer.until(lambda: force_n(observer.samples[-1]) == 0.0, PATIENCE_S, "a limp arm")
    end_s = time.monotonic() + PATIENCE_S
    while LIMP not in (gateway := rig.health_of("gateway")).detail:
        assert time.monotonic() < end_s, gateway.detail
    assert gateway.gauges["models_invalid"] > refused
    assert observer.is_up
    assert max(force_rates_n_s(observer.samples)) <= rate_limit_n_s()
    _feels(rig)
    assert max(force_rates_n_s(observer.samples)) <= rate_limit_n_s()


def test_lost_packets_make_no_force_step_beyond_the_limit(rig: FarRig) -> None:
    _feels(rig)
    rig.hosts.set(1.0, 1.0, 0.05)
    rig.look_for(1.0)
    assert max(force_rates_n_s(rig.observer.samples)) <= rate_limit_n_s()
    assert not rig.ended()
