"""The page of a rig in headless Chromium, until this process is ended: ``python page_viewer.py ADDRESS [--stereo]``.

It draws on the processor. Lines say when the first picture is there, and at the end how many came a second.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.chromium import Chromium

_LOAD_S, _LOOK_S = 120.0, 0.5


def main() -> int:
    """Look at the page until SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    parser.add_argument("--stereo", action="store_true", help="a picture for each eye")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    rates: list[float] = []
    with tempfile.TemporaryDirectory() as folder, Chromium(Path(folder) / "profile") as browser:
        try:
            browser.open(arguments.address)
            browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.view?.last)"), _LOAD_S, "a picture")
            if arguments.stereo:
                browser.evaluate("trocar.stereo.sides.switch(true)")
            print("a picture is there", flush=True)
            while True:
                time.sleep(_LOOK_S)
                if found := re.match(r"[\d.]+", browser.text("#picture-hz")):
                    rates.append(float(found[0]))
        finally:
            print(f"pictures a second, median: {np.median(rates) if rates else 0.0:.1f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
