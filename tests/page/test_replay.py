"""A recording whose pictures are shown: the page halts, steps, seeks and repeats it; a report's link leads there."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.made_samples import make_sample
from tests.patience import PATIENCE_S
from tests.ports import free_port
from tests.with_us import with_us
from trocar.services.recordings.reader import read_messages
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]

#: Of the recording that is shown.
TICKS = 7500


@dataclass
class Shown:
    """A recording that is shown, and a browser that looks at its page."""

    browser: Chromium
    address: str
    file: Path

    def replay(self) -> Any:
        return httpx.get(f"{self.address}api/state", timeout=PATIENCE_S).json().get("replay")

    def until(self, condition: str, what: str) -> None:
        """Wait until something holds of the recording `r`."""
        self.browser.until(lambda: eval(condition, {"r": self.replay()}), PATIENCE_S, what)

    def click(self, selector: str) -> None:
        self.browser.evaluate(f"document.querySelector({selector!r}).click()")

    def choose(self, selector: str, value: str) -> None:
        self.browser.evaluate(
            f"(() => {{ const it = document.querySelector({selector!r}); it.value = {value!r}; it.onchange(); }})()"
        )


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shown]:
    folder = tmp_path_factory.mktemp("shown")
    file = folder / "it's mine.mcap"
    make_sample(file, TICKS)
    settings = (
        f"transport.directory={folder / 'bus'}", f"supervisor.web.port={free_port()}",
        f"visualization.port={free_port()}",
    )  # fmt: skip
    options = [word for each in settings for word in ("--set", each)]
    command = [sys.executable, "-m", "trocar.services.cli.app", "replay", str(file), "--pictures", *options]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(with_us(command), stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        place = page_file(Transport(directory=folder / "bus"))
        try:
            with Chromium(folder / "profile", size=(480, 360)) as browser:
                browser.until(place.exists, PATIENCE_S, "the page is served")
                address = json.loads(place.read_text())["address"]
                browser.open(address)
                shown = Shown(browser, address, file)
                browser.until(
                    lambda: browser.evaluate("document.getElementById('replay')?.hidden === false"),
                    PATIENCE_S,
                    "it is told",
                )
                browser.until(lambda: browser.text("#tick").endswith(" s"), PATIENCE_S, "a picture came")
                yield shown
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def tick_s(shown: Shown) -> float:
    """Return the rig's time as the picture shows it."""
    return float(shown.browser.text("#tick").split()[0])


def test_the_page_halts_steps_and_goes_anywhere(shown: Shown) -> None:
    browser = shown.browser
    assert browser.text("#replay-file") == "it's mine.mcap"
    shown.click("#replay-halt")
    shown.until("r['halted']", "it stands")
    shown.choose("#replay-place", "6.03")  # between two states
    shown.until("r['place_s'] == 6.03", "it is there")
    browser.until(lambda: browser.text("#replay-time").startswith("0:06.0 of 0:"), PATIENCE_S, "it is said")
    places = [6.03]
    for line in ("s", "s", "b", "-5", "+5"):
        shown.click(f"#replay [data-line='{line}']")
        shown.until(f"abs(r['place_s'] - {places[-1]}) > 1e-3", f"{line} was heard")
        places.append(shown.replay()["place_s"])
    first, second, third, back, behind, ahead = places
    assert first < second < third
    assert 0.0 < third - second < 0.2, "a state of physics further"
    assert back == pytest.approx(second, abs=1e-3)
    assert behind == pytest.approx(back - 5.0)
    assert ahead == pytest.approx(back)


def test_the_picture_is_of_that_moment(shown: Shown) -> None:
    frames = [(time_ns, body.tick) for _, time_ns, body in read_messages(shown.file, ["gateway.state"])]
    for place_s in (1.0, 6.0, 3.0):
        shown.choose("#replay-place", str(place_s))
        wanted_s = 1e-3 * max(tick for time_ns, tick in frames if (time_ns - frames[0][0]) * 1e-9 <= place_s)
        is_there = lambda at_s=wanted_s: tick_s(shown) == pytest.approx(at_s, abs=0.1)  # noqa: E731
        shown.browser.until(is_there, PATIENCE_S, f"the picture of second {place_s}")


def test_rate_and_loop(shown: Shown) -> None:
    if shown.replay()["halted"]:
        shown.click("#replay-halt")
    if not shown.replay()["loop"]:
        shown.click("#replay-loop")
    shown.until("r['loop'] and not r['halted']", "it goes, again and again")
    shown.choose("#replay-rate", "4")
    shown.until("r['rate'] == 4.0", "at four times the clock")
    shown.choose("#replay-place", str(shown.replay()["length_s"] - 0.5))
    shown.until("r['place_s'] < r['length_s'] - 2.0", "it has begun again")
    shown.click("#replay-loop")
    shown.until("not r['loop'] and r['place_s'] == r['length_s']", "once more, and it stays at the end")


def test_the_link_of_a_report_leads_to_the_moment(shown: Shown) -> None:
    """In the tab that is open, as in a new one; of another recording it is said what shows it."""
    browser = shown.browser
    if not shown.replay()["halted"]:
        shown.click("#replay-halt")
    shown.until("r['halted']", "it stands")
    shown.choose("#replay-rate", "0.125")
    shown.until("r['rate'] == 0.125", "slowly")
    browser.evaluate("location.hash = 'replay=' + encodeURIComponent(\"it's mine.mcap\") + '&at=3.50'")
    shown.until("not r['halted'] and 3.5 <= r['place_s'] < 5.0", "it plays from there")
    browser.evaluate("location.hash = 'replay=other.mcap&at=3.25'")
    browser.until(lambda: browser.evaluate("!document.getElementById('replay-elsewhere').hidden"), PATIENCE_S, "said")
    assert browser.text("#replay-command") == "trocar replay 'other.mcap' --pictures --from 3.25"
    shown.click("#replay-close")
    assert browser.evaluate("document.getElementById('replay-elsewhere').hidden")
    browser.open("about:blank")
    browser.open(f"{shown.address}#replay=it's%20mine.mcap&at=5.50")
    shown.until("5.5 <= r['place_s'] < 7.0", "a new tab leads there, too")


def test_pages_of_other_sites_cannot_move_it(shown: Shown) -> None:
    assert httpx.post(f"{shown.address}api/replay", content="@1", timeout=PATIENCE_S).status_code == 403
