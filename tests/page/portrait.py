"""The picture of the page in the README: ``python -m tests.page.portrait docs/page.png``, in three minutes.

A browser that draws on the processor is made to draw as one with a graphics processor does, few pictures a second: what
is to be seen is how the page looks, not how this machine keeps up. It waits for everything else.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

from tests.chromium import Chromium
from tests.rig.conftest import running_rig
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file
from trocar.services.visualization.web import build

SIZE = (1440, 860)
INSERTED_MM = 15.0
_INSERTS_S, _DRAWS_S, _SETTLES_S = 120.0, 80.0, 240.0
#: The finest look of `governor.js`, which is not to take a coarser one.
FINEST = """
const {governor} = trocar.view;
governor.steps = [{ratio: 1, look: "wet", shadows: true, hz: 1}];
governor.coarser = () => false;
trocar.view.takeStep(0);
"""


def inserted_mm(browser: Chromium) -> float:
    """Return how far the catheter is in the duct, as the page says; 0 before the first picture."""
    words = browser.text("#inserted")
    return float(words.split()[0]) if words.endswith(" mm") else 0.0


def portrait(path: Path) -> None:
    """Write the page to `path` as a PNG, with the catheter in the duct."""
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        with running_rig(directory, "default", []), Chromium(directory / "profile", SIZE, 19) as browser:
            browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
            browser.open(json.loads(page_file(Transport(directory=directory / "bus")).read_text())["address"])
            browser.until(lambda: inserted_mm(browser) > INSERTED_MM, _INSERTS_S, "the catheter is in the duct")
            browser.evaluate(f"(() => {{{FINEST}}})()")
            time.sleep(_DRAWS_S)  # the reflections are made once, which costs ticks; curves fill meanwhile
            browser.until(lambda: browser.text("#rig-badge") == "RUNNING", _SETTLES_S, "the rig has got over that")
            browser.screenshot(path)


if __name__ == "__main__":
    if build.main():
        raise SystemExit("the page cannot be built")
    portrait(Path(sys.argv[1]))
