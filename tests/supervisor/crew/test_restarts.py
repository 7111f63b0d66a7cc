from __future__ import annotations

from trocar.services.supervisor.crew.restart_policy import RestartPolicy


def test_the_delay_grows_and_the_last_holds() -> None:
    policy = RestartPolicy((0.1, 0.5, 1.0), max_per_minute=5)
    assert [policy.delay_s(float(t)) for t in range(5)] == [0.1, 0.5, 1.0, 1.0, 1.0]
    assert policy.count == 5


def test_beyond_the_limit_per_minute_there_is_no_restart() -> None:
    policy = RestartPolicy((0.1,), max_per_minute=2)
    assert policy.delay_s(0.0) == 0.1
    assert policy.delay_s(59.0) == 0.1
    assert policy.delay_s(59.5) is None


def test_a_minute_later_the_first_restart_is_forgotten() -> None:
    policy = RestartPolicy((0.1, 0.5), max_per_minute=2)
    policy.delay_s(0.0)
    policy.delay_s(30.0)
    assert policy.delay_s(61.0) == 0.5  # the one at 30 s still counts
    assert policy.delay_s(62.0) is None


def test_arming_forgives() -> None:
    policy = RestartPolicy((0.1, 0.5), max_per_minute=1)
    policy.delay_s(0.0)
    assert policy.delay_s(1.0) is None
    policy.forgive()
    assert policy.delay_s(2.0) == 0.1


def test_no_restarts_allowed() -> None:
    assert RestartPolicy((), max_per_minute=0).delay_s(0.0) is None
    assert RestartPolicy((), max_per_minute=1).delay_s(0.0) == 0.0
