"""The last ticks of a loop, read by others while they are written, and what the stages took."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from tests.patience import PATIENCE_S
from trocar.services.runtime.errors import BusError, UserError
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures import stage_times
from trocar.services.runtime.measures.flight import COLUMNS, FlightRing, flight_directory, is_memory, remove_rings
from trocar.services.runtime.measures.flights import (
    Flights,
    ThreadTime,
    overrun_ns,
    read_file,
    read_ring,
    read_rings,
    to_bytes,
)

MS = 1_000_000


def _shared(directory: Path, name: str = "loop", stages: tuple[str, ...] = ("a", "b")) -> tuple[FlightRing, Path]:
    ring = FlightRing(1000.0, stages)
    path = directory / f"{name}.flight"
    ring.share(path)
    return ring, path


def test_what_a_loop_wrote_is_read_by_another(private_folder: Path) -> None:
    meter = LoopMeter(1000.0, ("a", "b"))
    meter.flight.share(private_folder / "loop.flight")
    for tick in range(3):
        meter.start(tick * MS, tick * MS + 100)
        meter.tick, meter.stages_ns = 70 + tick, (5, 7)
        meter.finish(tick * MS + 900 + tick)
    flight = read_ring(private_folder / "loop.flight")
    assert flight is not None
    assert (flight.name, flight.pid, flight.rate_hz, flight.stages) == ("loop", os.getpid(), 1000.0, ("a", "b"))
    assert flight.column("tick").tolist() == [70, 71, 72]
    assert flight.column("due_ns").tolist() == [0, MS, 2 * MS]
    assert flight.column("began_ns").tolist() == [100, MS + 100, 2 * MS + 100]
    assert flight.column("ended_ns").tolist() == [900, MS + 901, 2 * MS + 902]
    assert flight.rows[:, len(COLUMNS) :].tolist() == [[5, 7]] * 3
    assert overrun_ns(flight).tolist() == [900 - MS, 901 - MS, 902 - MS]


def test_stages_that_are_not_said_are_none_of_the_tick_before() -> None:
    meter = LoopMeter(1000.0, ("a",))
    for stages in ((9,), None):
        meter.start(0, 1)
        if stages:
            meter.stages_ns = stages
        meter.finish(2)
    rows = np.frombuffer(meter.flight.memory, np.int64, offset=4096 + 64).reshape(-1, 6)
    assert rows[:2, 5].tolist() == [9, 0]


def test_two_seconds_are_kept_and_the_newest(private_folder: Path) -> None:
    ring, path = _shared(private_folder)
    for tick in range(5000):
        ring.write(tick, 0, 0, 0, 0, (0, 0))
    flight = read_ring(path)
    assert flight is not None
    assert flight.column("tick").tolist() == list(range(3001, 5000))  # but the row that might be written just now


def test_rows_are_whole_while_they_are_written(private_folder: Path) -> None:
    ring, path = _shared(private_folder)
    stop = threading.Event()

    def write() -> None:
        k = 0
        while not stop.is_set():
            ring.write(k, k, k, k, k, (k, k))
            k += 1

    writer = threading.Thread(target=write)
    writer.start()
    try:
        until = time.monotonic() + PATIENCE_S
        seen = 0
        while seen <= 2 * ring.capacity:
            assert time.monotonic() < until, "nothing more is written"
            flight = read_ring(path)
            assert flight is not None
            assert (flight.rows == flight.rows[:, :1]).all()
            assert (np.diff(flight.rows[:, 0]) == 1).all()
            seen = max(seen, int(flight.rows[:, 0].max(initial=0)))
    finally:
        stop.set()
        writer.join()


def test_a_ring_of_a_killed_process_is_there_and_a_new_one_takes_its_place(private_folder: Path) -> None:
    old, path = _shared(private_folder)
    old.write(1, 0, 0, 0, 0, (0, 0))
    kept = read_ring(path)
    new, _ = _shared(private_folder)
    new.write(2, 0, 0, 0, 0, (0, 0))
    old.write(3, 0, 0, 0, 0, (0, 0))  # it still runs: what it writes goes nowhere, and hurts nobody
    flight = read_ring(path)
    assert kept is not None
    assert flight is not None
    assert (kept.column("tick").tolist(), flight.column("tick").tolist()) == ([1], [2])


def test_what_is_no_ring_is_left_out(private_folder: Path) -> None:
    _shared(private_folder, "good")
    (private_folder / "empty.flight").touch()
    (private_folder / "wrong.flight").write_bytes(os.urandom(10_000))
    (private_folder / "lying.flight").write_bytes(b"TROCARF1" + (9999).to_bytes(4, "little") + b"{" * 5000)
    (private_folder / "link.flight").symlink_to(private_folder / "good.flight")
    assert [flight.name for flight in read_rings(private_folder)] == ["good"]


def test_nobody_else_may_read_it(private_folder: Path) -> None:
    _, path = _shared(private_folder)
    assert path.stat().st_mode & 0o077 == 0
    private_folder.chmod(0o755)
    with pytest.raises(BusError, match="others may use it"):
        FlightRing(1000.0).share(path)


def test_rings_lie_in_memory_wherever_the_sockets_are(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    directory = flight_directory(tmp_path)
    assert is_memory(directory)
    assert directory.stat().st_mode & 0o077 == 0
    assert flight_directory(tmp_path) == directory
    _shared(directory)
    remove_rings(tmp_path)
    assert not list(directory.glob("*")) or directory == tmp_path


def test_a_file_gives_back_what_was_put_into_it(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    ring, path = _shared(tmp_path)
    ring.write(1, 2, 3, 4, 5, (6, 7))
    flight = read_ring(path)
    assert flight is not None
    thread = ThreadTime("physics", "python", 2.0, 0.5, 0.1, 40)
    file = tmp_path / "x.npz"
    file.write_bytes(
        to_bytes(Flights((flight,), 99, "2026-11-20T00:00:00+00:00", "physics: 1 ticks missed", (thread,)))
    )
    back = read_file(file)
    assert (back.taken_ns, back.reason, back.threads) == (99, "physics: 1 ticks missed", (thread,))
    assert back.flights[0].rows.tolist() == [[1, 2, 3, 4, 5, 6, 7]]
    assert (back.flights[0].name, back.flights[0].stages) == ("loop", ("a", "b"))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"\x80\x04pickle"])
def test_a_file_that_is_none_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "x.npz"
    file.write_bytes(content)
    with pytest.raises(UserError, match="is no file of flights"):
        read_file(file)


def test_a_broken_file_is_one_sentence(tmp_path: Path) -> None:
    """Some bytes break what was compressed, which is found out by none but the decompressor."""
    tmp_path.chmod(0o700)
    ring, path = _shared(tmp_path)
    for row in range(50):
        ring.write(row, row * row % 7, 3, 4, 5, (row, 7))
    flight = read_ring(path)
    assert flight is not None
    whole = to_bytes(Flights((flight,), 99, "2026-11-20T00:00:00+00:00", "physics: 1 ticks missed", ()))
    file = tmp_path / "x.npz"
    for place in range(len(whole)):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with contextlib.suppress(UserError):
            read_file(file)


def test_buckets_are_where_their_edges_say() -> None:
    edges = stage_times.edges_ns()
    inside = edges.astype(np.int64)
    # An edge is the first value of the bucket above it; whole nanoseconds below 2**24 are exact in single precision.
    exact = inside[inside < 1 << 24]
    assert stage_times.buckets_of(exact).tolist() == list(range(1, len(exact) + 1))
    assert stage_times.buckets_of(exact - 1).tolist() == list(range(len(exact)))
    assert stage_times.buckets_of(np.array([1, 1 << 40])).tolist() == [0, stage_times.BUCKETS - 1]


def test_quantiles_of_stages_are_within_a_bucket() -> None:
    """Against numpy's quantiles of the same durations; buckets are at most a quarter wide, and interpolated in."""
    random = np.random.default_rng(3)
    meter = LoopMeter(1000.0, ("a", "b"))
    times = stage_times.StageTimes(meter.flight)
    durations = np.exp(random.normal([np.log(2e4), np.log(3e5)], [0.6, 0.3], size=(6000, 2))).astype(np.int64)
    counts = []
    for k, row in enumerate(durations.tolist()):
        meter.flight.write(k, 0, 0, 0, 0, row)
        if k % 100 == 99:
            counts = [stage.counts.view() for stage in times.take_costs()]
    for stage in range(2):
        assert counts[stage].sum() == 6000
        for q in (0.5, 0.99):
            true_us = np.quantile(durations[:, stage], q) / 1e3
            assert stage_times.quantile_us(counts[stage], q) == pytest.approx(true_us, rel=0.13)


def test_sums_maxima_and_means_of_stages() -> None:
    meter = LoopMeter(1000.0, ("a", "b"))
    times = stage_times.StageTimes(meter.flight)
    for k in range(4):
        meter.flight.write(k, 0, 0, 0, 0, (1000 * (k + 1), 0))
    a, b = times.take_costs()
    assert (a.mean_us, a.max_us, a.sum_us) == (2.5, 4.0, 10.0)
    assert (b.mean_us, b.max_us, b.sum_us) == (0.0, 0.0, 0.0)
    assert b.counts.view().sum() == 0  # it did not run
    meter.flight.write(4, 0, 0, 0, 0, (1000, 2000))
    a, b = times.take_costs()
    assert (a.mean_us, a.max_us, a.sum_us, a.counts.view().sum()) == (1.0, 1.0, 11.0, 5)
    assert (b.max_us, b.counts.view().sum()) == (2.0, 1)


def test_ticks_that_the_ring_lost_are_not_counted_twice() -> None:
    meter = LoopMeter(1000.0, ("a",))
    times = stage_times.StageTimes(meter.flight)
    for k in range(meter.flight.capacity + 10):
        meter.flight.write(k, 0, 0, 0, 0, (1000,))
    (a,) = times.take_costs()
    assert a.counts.view().sum() == meter.flight.capacity
