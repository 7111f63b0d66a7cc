"""Benches that share a database: processes that add, list, export, erase and open anew, by chance."""

from __future__ import annotations

import multiprocessing
import random
import time
from pathlib import Path

import msgspec

from trocar.review.attempts.assessment import Assessment, RigQuality
from trocar.review.attempts.store.attempts import Store, StoreError

TRAINEES = "heron-17", "wren-2", "magpie-2"
_FORK = multiprocessing.get_context("forkserver")
_FORK.set_forkserver_preload([__name__])


def made_up(name: str) -> Assessment:
    """Return an attempt that is known by its name."""
    return Assessment(
        attempt_id=name, scenario="basic", title="Insert", outcome="success", reason="", source=f"{name}.mcap",
        began_ns=1, began_at_s=0.0, version="1", why_not=(), time_s=20.0, time_limit_s=300.0, goal_depth_m=0.02,
        depth_max_m=0.03, phases=[], errors=[], metrics={"time_s": 20.0}, limits={}, score=None, rig=RigQuality(),
    )  # fmt: skip


def work(url: str, bench: int, attempts: int, seed: int, begins_s: float, errors: multiprocessing.Queue[str]) -> None:
    """Keep so many attempts of trainees whom all benches share, and do something else before each."""
    chance = random.Random(f"{seed} {bench}")
    time.sleep(max(0.0, begins_s - time.time()))
    try:
        store = Store(url)
        for k in range(attempts):
            another = chance.choice((_list, _export, _erase, _judge_again, None))
            if another is not None:
                another(store, f"{bench}-{k - 1 if another is _judge_again and k else k}", chance)
            if chance.random() < 0.2:
                store.__exit__(None, None, None)
                store = Store(url)
            store.add(made_up(f"{bench}-{k}"), TRAINEES[k % len(TRAINEES)], Path(f"/nowhere/{bench}.mcap"))
    except BaseException as error:
        errors.put(f"bench {bench}: {type(error).__name__}: {error}")
        raise


def _list(store: Store, _name: str, chance: random.Random) -> None:
    store.listed(chance.choice((*TRAINEES, None)))


def _export(store: Store, _name: str, _chance: random.Random) -> None:
    msgspec.json.decode(store.export())


def _erase(store: Store, name: str, chance: random.Random) -> None:
    """Come and go: a trainee whom benches also share, with an attempt of each."""
    store.add(made_up(f"guest-{name}"), "guest", Path("/nowhere/guest.mcap"))
    try:
        store.erase_with_recordings("guest") if chance.random() < 0.5 else store.erase("guest")
    except StoreError as error:
        if "there is no trainee 'guest'" not in str(error):  # another bench was first
            raise


def _judge_again(store: Store, name: str, _chance: random.Random) -> None:
    bench, _, k = name.partition("-")
    store.add(made_up(name), TRAINEES[int(k) % len(TRAINEES)], Path(f"/nowhere/{bench}.mcap"))


def keep_at_once(url: str, benches: int, attempts: int, seed: int) -> tuple[int, list[str]]:
    """Let benches work at once; return how many attempts are lost, and what they died of."""
    errors: multiprocessing.Queue[str] = _FORK.Queue()
    begins_s = time.time() + 1.0
    every = [
        _FORK.Process(target=work, args=(url, bench, attempts, seed, begins_s, errors)) for bench in range(benches)
    ]
    for each in every:
        each.start()
    for each in every:
        each.join()
    said = [errors.get() for each in every if each.exitcode]
    with Store(url) as store:
        kept = [row for row in store.listed() if row.trainee in TRAINEES]
        exported = msgspec.json.decode(store.export())["attempts"]
    assert len({row.id for row in kept}) == len(kept)
    names = {each["attempt_id"] for each in exported if each["trainee"] in TRAINEES}
    expected = {f"{bench}-{k}" for bench in range(benches) for k in range(attempts)}
    assert names <= expected
    assert len(kept) == len(names), "each is kept once"
    return len(expected - names), said
