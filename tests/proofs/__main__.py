"""Proofs by many trials: ``python -m tests.proofs``, part of ``./dev test --long``; docs/results/proofs.md is its page.

Each goes on where the last run stopped, until it has as many cases as are asked for; all of them take some six hours.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import sys
import time
from pathlib import Path

from benchmarks.report import describe_run, end_in_good_order
from tests.proofs import faults, frames, hands, recordings, soak, two_hosts
from tests.proofs.page import page
from tests.proofs.trials import Ledger, counted, go_on, tried
from trocar.services.files.atomic_file import atomic_file

ROOT = Path(__file__).parents[2]
LINES, PAGE = ROOT / "benchmarks" / "results" / "proofs", ROOT / "docs" / "results" / "proofs.md"
PROOFS = {
    each.name: each
    for each in (
        frames.PROOF, hands.PROOF, recordings.CUTS, recordings.FLIPS, two_hosts.PHYSICS, two_hosts.SUPERVISOR,
        faults.PROOF, soak.PROOF,
    )
}  # fmt: skip


def main() -> int:
    """Go on with the proofs and write the page; the exit code is 1 if any case ever failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PROOFS, default=list(PROOFS))
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long, to go on another time")
    parser.add_argument("--anew", action="store_true", help="forget the earlier trials of these proofs")
    parser.add_argument("--seed", type=int, help="make this trial of one proof again, and keep nothing")
    options = parser.parse_args()
    end_in_good_order()
    if options.seed is not None:
        with PROOFS[options.only[0]].begin() as try_once:
            print(found := tried(try_once, options.seed))
        return int(found.failed > 0)
    run = describe_run()
    LINES.mkdir(exist_ok=True)
    lock = os.open(LINES, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # two rigs beside each other would prove nothing
    except BlockingIOError:
        sys.exit("proofs are run by another process")
    ledger = Ledger(LINES, run["commit"])
    until_s = time.monotonic() + 60.0 * options.minutes
    for proof in (PROOFS[name] for name in options.only):
        if options.anew:
            ledger.forget(proof)
        if why := proof.hindered():
            print(f"{proof.name}: {why}", file=sys.stderr)
        else:
            go_on(proof, ledger, until_s, lambda text: print(text, file=sys.stderr, flush=True))
    lines = {proof: ledger.lines(proof) for proof in PROOFS.values()}
    with atomic_file(PAGE) as half:
        half.write_text(page(lines, f"{run['cores']} cores of {run['cpu']}"), encoding="utf-8")
    return int(any(each.found.failed for proof, some in lines.items() for each in counted(proof, some)))


if __name__ == "__main__":
    sys.exit(main())
