"""What the supervisor keeps of readers that say that somebody floods."""

from trocar.services.supervisor.crew.floods import Floods


def test_a_reader_that_starts_anew_counts_from_zero_again() -> None:
    floods = Floods()
    assert "70 frames" in floods.messages("haptics", 1, {"physics.state": 70.0}, 0.0)[0]
    assert floods.messages("haptics", 1, {"physics.state": 70.0}, 20.0) == []
    assert "60 frames" in floods.messages("haptics", 2, {"physics.state": 60.0}, 40.0)[0]
    assert "5 frames" in floods.messages("haptics", 2, {"physics.state": 65.0}, 60.0)[0]


def test_what_is_kept_does_not_grow_with_what_a_reader_makes_up() -> None:
    floods = Floods()
    for n in range(200):
        assert floods.messages("haptics", n, {f"made up {n}": 70.0}, 0.0) == []
        floods.messages("haptics", n, {"physics.state": 70.0}, 0.0)
    assert len(floods._counted) == 1
