"""The page open on the rig's own machine, in a browser that draws on the processor: what it shows, and what it costs.

    python benchmarks/bench_page.py [--minutes 10] [trocar up's options]

The stub rig for half a minute without a browser, then with headless Chromium on its page (software rendering, on the
cores that the rig runs on): misses of the loops beside the machine's floor, alarms and how many of them were false,
time until the page shows its first picture, pictures a second on it, and how long the web server takes to answer.
"""

from __future__ import annotations

import argparse
import re
import time
from pathlib import Path

import numpy as np
from report import Row, write_report
from watched_rig import WatchedRig, print_alarms

from tests.chromium import Chromium
from trocar.services.visualization.web import build

ALONE_S, SETTLE_S, LOAD_S = 30.0, 10.0, 120.0


def load(browser: Chromium, address: str, picture: Path) -> float:
    """Open the page in a browser that has drawn something; return the seconds until its first picture."""
    browser.screenshot(picture)  # the process that draws starts with the first: a second that is not the page's
    began_s = time.monotonic()
    browser.open(address)
    browser.until(lambda: browser.evaluate("document.querySelector('#view.ready') !== null"), LOAD_S, "loaded")
    browser.until(lambda: browser.text("#tick").endswith(" s"), LOAD_S, "a picture")
    return time.monotonic() - began_s


def with_browser(rig: WatchedRig, seconds: float) -> list[Row]:
    """Return the table of so long with the page open."""
    pictures: list[float] = []
    with Chromium(rig.directory / "profile") as browser:
        loaded_s = load(browser, rig.address, rig.directory / "blank.png")
        rig.settle(SETTLE_S)

        def look() -> None:
            if found := re.match(r"[\d.]+", browser.text("#picture-hz")):
                pictures.append(float(found[0]))

        rig.watch(seconds, look)
        how = browser.text("#drawn-how")
    print_alarms(rig, f"browser; {how}")
    return [
        *rig.rows("browser"),
        Row("browser: page loaded, first picture", loaded_s, "s", 3.0),
        Row("browser: pictures a second, median", float(np.median(pictures)), "1/s", 10.0, at_least=True),
        Row("browser: pictures a second, 1 % of the looks below", float(np.percentile(pictures, 1)), "1/s"),
    ]


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    arguments, options = parser.parse_known_args()
    if build.main():  # an older page was measured more than once
        raise SystemExit("the page cannot be built: what lies there may be another one")
    with WatchedRig(options) as rig:
        rig.settle(SETTLE_S)
        rig.watch(min(ALONE_S, 60.0 * arguments.minutes))
        print_alarms(rig, "no browser")
        rows = rig.rows("no browser")
        rows += with_browser(rig, 60.0 * arguments.minutes)
    notes = (
        f"{arguments.minutes:g} minutes with the page open in headless Chromium (SwiftShader) on the rig's own cores, "
        "after half a minute without. An alarm is false where the histograms of the loop or path that it names do not "
        "show what it says."
    )
    write_report("page", "The page beside the rig", rows, notes)


if __name__ == "__main__":
    main()
