"""One fraction of a whole start: never falling, ending at one, whatever its parts say."""

from __future__ import annotations

from trocar.services.start.start_progress import StartProgress

Said = list[tuple[str, float]]


def test_parts_take_their_share_and_a_stage_that_begins_again_does_not_go_back() -> None:
    said: Said = []
    start = StartProgress({"contact": 3.0, "duct": 1.0}, lambda stage, fraction: said.append((stage, fraction)))
    contact, duct = start.part("contact"), start.part("duct")
    contact("kernels", 0.0)
    contact("kernels", 0.5)
    contact("kernels", 0.2)
    contact("kernels", 7.0)
    duct("modes", 0.0)
    duct("modes", 1.0)
    duct("residual compliance", 0.0)
    start.finish("done")
    assert said == [
        ("kernels", 0.0), ("kernels", 0.375), ("kernels", 0.375), ("kernels", 0.75), ("modes", 0.75), ("modes", 1.0),
        ("residual compliance", 1.0), ("done", 1.0),
    ]  # fmt: skip


def test_a_stage_that_is_no_part_is_told_where_it_stands() -> None:
    said: Said = []
    start = StartProgress({"assembly": 1.0, "modes": 1.0}, lambda stage, fraction: said.append((stage, fraction)))
    start.stage("modes", 0.5)
    start.stage("cubic energy", 0.0)
    assert said == [("modes", 0.75), ("cubic energy", 0.75)]
