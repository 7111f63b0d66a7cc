"""Figures that pages quote from committed tables: ``python -m tests.docs.quoted`` writes them into the pages.

A quote is the sentence or the line of a table as it stands in a page, with a name in braces for each figure. So the
page holds nothing but what a reader reads, and a sentence that is written anew has to be written anew here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_FIGURE = r"([^\s|]+?)"


@dataclass(frozen=True)
class Quote:
    """A passage of a page, and where its figures come from: white space is any white space."""

    page: str
    passage: str

    def pattern(self) -> re.Pattern[str]:
        """Return what finds the passage with whatever figures; those of each name in turn."""
        parts = re.split(r"\{\w+\}", self.passage)
        words = [r"\s+".join(re.escape(word) for word in re.split(r"\s+", part)) for part in parts]
        return re.compile(_FIGURE.join(words))

    def names(self) -> list[str]:
        """Return the names of the figures in their order."""
        return re.findall(r"\{(\w+)\}", self.passage)


def _rows(name: str) -> dict[str, dict[str, Any]]:
    """Return the rows of a table of benchmarks/results by their name."""
    text = (ROOT / "benchmarks" / "results" / f"{name}.json").read_text(encoding="utf-8")
    return {row["name"]: row for row in json.loads(text)["rows"]}


def _study(name: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the rows of a table of docs/results/accuracy by setting and quantity."""
    text = (ROOT / "docs" / "results" / "accuracy" / f"{name}.json").read_text(encoding="utf-8")
    return {(row["setting"], row["quantity"]): row for row in json.loads(text)["rows"]}


def _digits(value: float, digits: int = 2) -> str:
    """Return a number of so many significant digits, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):g}" if value < 1000.0 else f"{float(f'{value:.{digits}g}'):,.0f}"


#: Rows of the table of the rig, by the name that a figure begins with.
_OF_RIG = {
    "gateway_late": "gateway: late or lost ticks",
    "haptics_late": "haptics: late or lost ticks",
    "physics_late": "physics: late or lost ticks",
    "gateway_work": "gateway: work, median",
    "gateway_work99": "gateway: work, 99 %",
    "haptics_work": "haptics: work, median",
    "haptics_work99": "haptics: work, 99 %",
    "physics_work": "physics: work, median",
    "physics_work99": "physics: work, 99 %",
    "servo99": "servo, 99 %",
    "model": "device_model, median",
    "model99": "device_model, 99 %",
    "answered": "samples answered in the next tick",
    "processor": "real-time threads' processor time",
    "start": "start to RUNNING, warm cache",
    "frames": "visualization: rate",
}


def _figures_of_rig() -> Iterator[tuple[str, str]]:
    """Yield value and limit of each row; a value that misses its limit is bold where a table marks it."""
    rows = _rows("rig")
    for name, title in _OF_RIG.items():
        row = rows[f"alone: {title}"]
        value, limit = row["value"], row["limit"]
        shown = f"{value:.2f}" if name == "answered" else _digits(value, 3 if value >= 100.0 else 2)
        yield name, shown
        yield f"{name}_marked", shown if row["passed"] else f"**{shown}**"
        if limit is not None:
            yield f"{name}_limit", f"{limit:g}" if limit >= 0.2 else _digits(limit)
    for loop in ("gateway", "haptics", "physics"):
        late = rows[f"alone: {loop}: late or lost ticks"]["value"]
        yield f"{loop}_in_time", f"{100.0 - late:.{2 if late > 0.01 else 3}f}"


def _figures_of_studies() -> Iterator[tuple[str, str]]:
    default, step = _study("default"), _study("timestep")
    pinch, hand, whole = "force at the tool, pinch", "force of the inserting hand", "force over an insertion"
    for name, setting in (("coarse", "20 x 26 cells"), ("usual", "as it is"), ("fine_rod", "80 segments")):
        yield f"{name}_us", f"{default[setting, pinch]['cost']['median_us']:.0f}"
        yield f"{name}_pinch", f"{default[setting, pinch]['error']:.1f}"
        yield f"{name}_hand", f"{default[setting, hand]['error']:.1f}"
    long, short = step["1 ms", whole], step["0.5 ms", whole]
    for name, row in (("long", long), ("short", short)):
        yield f"{name}_error", _digits(row["error"], 3)
        yield f"{name}_us", f"{row['cost']['median_us']:.0f}"
    yield "step_times", f"{short['cost']['median_us'] / long['cost']['median_us']:.1f}"
    yield "step_part", f"{100.0 * short['error'] / long['error']:.0f}"


def _figures_of_chain() -> Iterator[tuple[str, str]]:
    rows = _rows("chain")
    for name, kind in (("rig", "as the rig"), ("zmq", "libzmq")):
        for what, of in (("frame", "frame at haptics"), ("model", "model at the gateway"),
                         ("contacts", "contacts at physics")):  # fmt: skip
            yield f"chain_{name}_{what}", f"{rows[f'{kind}: {of}']['value']:.0f}"
        yield f"chain_{name}_switches", _digits(rows[f"{kind}: context switches"]["value"])
    yield "chain_waits", f"{rows['as the rig, the gateway waits: model at the gateway']['value']:.0f}"


def _figures_of_batches() -> Iterator[tuple[str, str]]:
    rows = _rows("batch")
    for name, row in (
        ("batch_one", "steps of all scenes, 1 scene in one process"),
        ("batch_64", "steps of all scenes, 64 scenes in one process"),
        ("batch_scene_mb", "each further scene"),
        ("batch_process_mb", "each further process"),
    ):
        yield name, f"{rows[row]['value']:.0f}"


def figures() -> dict[str, str]:
    """Return all figures by their name, as the committed tables have them."""
    cold, first = _rows("start-cold"), _rows("first-start")
    found = {
        "cold_s": f"{cold['cold start to RUNNING']['value']:.0f}",
        "cold_limit_s": f"{cold['cold start to RUNNING']['limit']:.0f}",
        "cold_processor_s": f"{cold['cold processor time']['value']:.0f}",
        "first_limit_s": f"{first['wheel: first start to RUNNING']['limit']:.0f}",
        "first_wheel_s": f"{first['wheel: first start to RUNNING']['value']:.1f}",
        "first_clone_s": f"{first['clone: first start to RUNNING']['value']:.0f}",
        "warm_s": _digits(_rows("start-warm")["warm start to RUNNING"]["value"]),
    }
    tables = _figures_of_rig, _figures_of_studies, _figures_of_chain, _figures_of_batches
    return found | {name: figure for of_table in tables for name, figure in of_table()}


README, FAST, STUDY = "README.md", "docs/explanation/fast-path.md", "docs/tutorials/first-study.md"
ENVIRONMENTS = "docs/how-to/environments.md"
QUOTES = (
    Quote(README, "the first start compiles, in {cold_s} s on two quiet cores"),
    Quote(README, "later starts take {warm_s} s."),
    Quote(README, "| gateway: devices and servo | 1000 Hz | 99.9 % | {gateway_in_time} % |"),
    Quote(README, "| haptics: tools and local force models | 1000 Hz | 99.9 % | {haptics_in_time} % |"),
    Quote(README, "| physics: duct, catheter, contacts | 1000 Hz | 99.9 % | {physics_in_time} % |"),
    Quote(README, "100 us from pose to force | {servo99} us |"),
    Quote(README, "0.8 ms from device sample to its force model at the gateway | {model99} us |"),
    Quote(
        README,
        "the error of a pinch falls from {coarse_pinch} to {usual_pinch} %, and a tick of physics takes {usual_us} us "
        "instead of {coarse_us}.",
    ),
    Quote(
        README,
        "the error of an insertion's force falls from {usual_hand} to {fine_rod_hand} %, and a tick takes "
        "{fine_rod_us} us instead of {usual_us}.",
    ),
    Quote(FAST, "| device frame at haptics, us | {chain_zmq_frame} | {chain_rig_frame} |"),
    Quote(FAST, "| force model at the gateway, us | {chain_zmq_model} | {chain_rig_model} |"),
    Quote(FAST, "| contacts at physics, us | {chain_zmq_contacts} | {chain_rig_contacts} |"),
    Quote(FAST, "| context switches per second | {chain_zmq_switches} | {chain_rig_switches} |"),
    Quote(FAST, "it has it after {chain_waits} us."),
    *(
        Quote(FAST, f"| late or lost ticks of {loop}, % | {{{loop}_late_limit}} | {{{loop}_late_marked}} |")
        for loop in ("gateway", "haptics", "physics")
    ),
    *(
        Quote(
            FAST,
            f"| {loop}{of} work, median and 99th percentile, us | {{{loop}_work_limit}}, {{{loop}_work99_limit}} | "
            f"{{{loop}_work_marked}}, {{{loop}_work99_marked}} |",
        )
        for loop, of in (("gateway", "'s"), ("haptics", "'"), ("physics", "'"))
    ),
    Quote(FAST, "| latency `servo`, 99th percentile, us | {servo99_limit} | {servo99_marked} |"),
    Quote(
        FAST,
        "| latency `device_model`, median and 99th percentile, us | {model_limit}, {model99_limit} | {model_marked}, "
        "{model99_marked} |",
    ),
    Quote(FAST, "| samples answered in the next tick, % | {answered_limit} | {answered_marked} |"),
    Quote(FAST, "| processor time of real-time threads, % of a core | {processor_limit} | {processor_marked} |"),
    Quote(FAST, "| warm start to RUNNING, s | {start_limit} | {start_marked} |"),
    Quote(FAST, "has a budget of {cold_limit_s} s. It takes [{cold_s} s]"),
    Quote(FAST, "{cold_processor_s} s of processor time"),
    Quote(FAST, "It has a budget of {first_limit_s} s and took [{first_wheel_s} s]"),
    Quote(FAST, "one from a clone took {first_clone_s} s instead of {cold_s}."),
    Quote(STUDY, "force over an insertion 1 ms {long_error} % {long_us} timestep"),
    Quote(STUDY, "force over an insertion 0.5 ms {short_error} % {short_us} The"),
    Quote(STUDY, "steps of 0.5 ms take {step_times} times the time of steps of 1 ms and have {step_part} % of the"),
    Quote(
        ENVIRONMENTS,
        "On one core 64 scenes take {batch_64} steps a second together, one scene {batch_one}; a further scene takes "
        "{batch_scene_mb} MB, a further process {batch_process_mb} MB",
    ),
)  # fmt: skip


def quoted(quote: Quote, text: str) -> list[str]:
    """Return the figures that a page has in a passage now.

    Raises ValueError if the passage does not stand in it exactly once.
    """
    found = quote.pattern().findall(text)
    if len(found) != 1:
        raise ValueError(f"{quote.page} holds {len(found)} times: {quote.passage}")
    return [found[0]] if isinstance(found[0], str) else list(found[0])


def with_figures(quote: Quote, text: str, values: Mapping[str, str]) -> str:
    """Return the text of a page with the figures of a passage as the tables have them."""
    match = quote.pattern().search(text)
    if match is None:
        raise ValueError(f"{quote.page} does not hold: {quote.passage}")
    for group, name in reversed([*enumerate(quote.names(), 1)]):
        text = text[: match.start(group)] + values[name] + text[match.end(group) :]
    return text


def main() -> None:
    """Write the figures into all pages."""
    values = figures()
    for quote in QUOTES:
        page = ROOT / quote.page
        page.write_text(with_figures(quote, page.read_text(encoding="utf-8"), values), encoding="utf-8")


if __name__ == "__main__":
    main()
