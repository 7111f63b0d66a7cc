"""What all trials came to, as a page: of how many that are asked, with which rates."""

from __future__ import annotations

import statistics
import subprocess
from collections.abc import Mapping, Sequence
from textwrap import shorten

from tests.proofs import flat
from tests.proofs.trials import Line, Proof, counted
from trocar.studies.rates import rate

_SHOWN, _LONGEST = 20, 120


def page(lines: Mapping[Proof, Sequence[Line]], machine: str) -> str:
    """Return the page in Markdown."""
    rows = [
        "# Proofs at scale", "",
        f"Written by `python -m tests.proofs` on {machine}; do not edit by hand. A run continues the last "
        "one. Cases are random; a rate of failure is its 95 % confidence interval (Clopper and Pearson), "
        "of the searches where those made the cases.", "",
        "|cases|tried|failed|rate of failure|what must hold|code|", "|---|---|---|---|---|---|",
        *(_row(proof, some) for proof, some in lines.items()), "",
    ]  # fmt: skip
    for proof, some in lines.items():
        rows += _by_kind(proof, some) if any("s" in each.found.figures for each in some) else []
        rows += _soaked(proof, counted(proof, list(some))) if proof.at_once else []
    failures = [(proof, each) for proof, some in lines.items() for each in some if each.found.failed]
    rows += ["## What failed", ""] if failures else []
    rows += [f"- {proof.name}, seed {each.seed}: {shorten(each.found.why[0].splitlines()[-1], _LONGEST)}"
             for proof, each in failures[:_SHOWN]]  # fmt: skip
    rows += [f"- and {len(failures) - _SHOWN} more"] if len(failures) > _SHOWN else []
    return "\n".join(rows).rstrip() + "\n"


def _row(proof: Proof, lines: Sequence[Line]) -> str:
    failed = sum(each.found.failed for each in lines)
    tried = sum(each.found.tried for each in counted(proof, list(lines)))
    of = f"{tried:,}" if tried >= proof.asked else f"{tried:,} of {proof.asked:,}"
    why_not = proof.hindered() if tried < proof.asked else ""
    of += f" ({why_not})" if why_not else ""
    of += f", by {len(lines):,} {proof.chance_of}" if proof.chance_of else ""
    return (
        f"|{proof.cases}|{of}|{failed}|{_rate(proof, lines)}|{proof.holds}|{code_of([each.commit for each in lines])}|"
    )


def code_of(commits: Sequence[str]) -> str:
    """Return the commits whose code was tried, and how old the first of them is, by the history that is checked out."""
    known = [each for each in dict.fromkeys(commits) if _git("merge-base", "--is-ancestor", each, "HEAD") is not None]
    ages = {each: int(_git("rev-list", "--count", f"{each}..HEAD") or 0) for each in known}
    said = []
    if known:
        first = max(known, key=ages.__getitem__)
        since = "commit" if ages[first] == 1 else "commits"
        age = f"{_git('log', '-1', '--format=%cs', first)}, {ages[first]} {since} ago"
        said.append(f"{', '.join(known)} ({age if len(known) == 1 else f'{first}: {age}'})")
    if lost := sum(each not in known for each in commits):
        said.append(f"{lost} of {len(commits)} trials by code that cannot be named: its commit is not in the history")
    return "; ".join(said)


def _git(*words: str) -> str | None:
    """Return what git says of this repository, None where it knows no such thing."""
    done = subprocess.run(["git", *words], cwd=flat.ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def _rate(proof: Proof, lines: Sequence[Line]) -> str:
    """Return the rate of failure among what is independent: cases, or the trials that made them."""
    if proof.chance_of:
        return f"{rate(sum(each.found.failed > 0 for each in lines), len(lines))} of {proof.chance_of}"
    return rate(*(sum(getattr(each.found, name) for each in lines) for name in ("failed", "tried")))


def _by_kind(proof: Proof, lines: Sequence[Line]) -> list[str]:
    rows = [f"## {proof.cases.capitalize()}", "", "|kind|tried|failed|rate|least force, N|median, s|longest, s|",
            "|---|---|---|---|---|---|---|"]  # fmt: skip
    for kind in sorted({each.found.kind for each in lines}):
        some = [each.found for each in lines if each.found.kind == kind]
        failed, tried = sum(each.failed for each in some), sum(each.tried for each in some)
        seconds = [each.figures["s"] for each in some if "s" in each.figures]
        took = f"{statistics.median(seconds):.1f}|{max(seconds):.1f}" if seconds else "|"
        pressed = [each.figures["N"] for each in some if "N" in each.figures]
        least = f"{min(pressed):.2f}" if pressed else ""
        rows.append(f"|{kind}|{tried}|{failed}|{rate(failed, tried)}|{least}|{took}|")
    return [*rows, ""]


def _soaked(proof: Proof, lines: Sequence[Line]) -> list[str]:
    """Return how memory grew, by a straight line through all minutes, and misses in both halves of them."""
    figures = [each.found.figures for each in lines if each.found.figures]
    if len(figures) < 4:
        return []
    rows = [f"## {proof.cases.capitalize()}", "",
            "|process|first, MB|last, MB|growth, MB per hour (95 %)|at most|first descriptors|last descriptors|",
            "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name, held in flat.series(figures, " MB"):
        low, high = flat.growth(held)
        counts = [each[f"{name} descriptors"] for each in figures]
        grows, of = f"{low:.1f} to {high:.1f}|{flat.most_mb_h(held[0]):.1f}", f"{counts[0]:g}|{counts[-1]:g}"
        rows.append(f"|{name}|{held[0]:.1f}|{held[-1]:.1f}|{grows}|{of}|")
    rows += ["", "|loop|misses of 1,000 ticks in the first half|in the second|chance of that|", "|---|---|---|---|"]
    half = len(figures) // 2
    for name, misses in flat.series(figures, " misses"):
        first, second = statistics.mean(misses[:half]), statistics.mean(misses[half:])
        rows.append(f"|{name}|{first:.2f}|{second:.2f}|{flat.chance_of(misses):.3g}|")
    return [*rows, ""]
