"""The page as it is served, over TLS, in a browser: its policy stops nothing of its own, and all that is foreign."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.patience import PATIENCE_S
from tests.review.class_of_pages import served
from tests.supervisor.made_up import Bench, rig, shown
from tests.visualization.test_view_server import Show
from trocar.protocol import bodies
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.web.web_certificate import Certificate, make
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.supervisor.page.web import PageContext, build_app

pytestmark = pytest.mark.skipif(chromium.find() is None or not DIST.is_dir(), reason="there is no browser, or no page")
_NOTED = """
globalThis.faults = [];
addEventListener("securitypolicyviolation", (event) => faults.push(`${event.violatedDirective} ${event.blockedURI}`));
addEventListener("error", (event) => faults.push(`error ${event.error?.stack ?? event.message}`));
addEventListener("unhandledrejection", (event) => faults.push(`rejected ${event.reason}`));
for (const name of ["error", "warn"]) {
  const say = console[name].bind(console);
  console[name] = (...said) => { faults.push(`${name} ${said.join(" ")}`); say(...said); };
}
"""
#: What somebody would put into the page who has found a way to.
_FOREIGN = """
(() => {
  const foreign = `<p id="foreign" style="color: red" onclick="globalThis.owned = 1">x</p>`;
  document.body.insertAdjacentHTML("beforeend", foreign);
  const script = document.createElement("script");
  script.textContent = "globalThis.owned = 1";
  document.body.append(script);
  document.getElementById("foreign").click();
  fetch("https://elsewhere.example/").catch(() => 0);
})()
"""


@pytest.fixture
def certificate(tmp_path: Path) -> Certificate:
    return make(tmp_path / "keys", ["localhost", "127.0.0.1"])


@pytest.fixture
def browser(tmp_path: Path, certificate: Certificate) -> Iterator[Chromium]:
    made_up: Rig = rig(supervisor={"web": {"keys": certificate.file.parent}})
    bench = Bench(made_up)
    bench.run(1.0)
    with Show(0.05, certificate) as show:
        show.notice = '{"type": "rig", "state": "running", "reason": "", "safe_stop": false}'
        context = PageContext(
            rig=made_up, scene="test", registries={}, ask=lambda _: bodies.Answer(order=0, ok=True),
            healthy=lambda: (True, ""), view_port=lambda: show.port, latest=msgspec.json.encode(shown(bench)),
        )  # fmt: skip
        with (
            served(build_app(context), certificate=certificate) as [address],
            Chromium(tmp_path / "profile") as browser,  # ends first: a server waits for who is connected
        ):
            browser.command("Security.enable")
            browser.command("Security.setIgnoreCertificateErrors", ignore=True)
            browser.command("Page.addScriptToEvaluateOnNewDocument", source=_NOTED)
            browser.open(address)
            yield browser
            context.closing = True


def test_page_and_picture_work_under_their_policy_and_nothing_foreign_does(browser: Chromium) -> None:
    browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.view?.last)"), PATIENCE_S, "a picture over wss")
    assert browser.evaluate("trocar.view.stream.address").startswith("wss://127.0.0.1:")
    assert browser.evaluate("faults") == []
    browser.evaluate(_FOREIGN)
    time.sleep(0.2)
    assert browser.evaluate("globalThis.owned ?? 0") == 0
    stopped = {fault.split()[0] for fault in browser.evaluate("faults")}
    assert {"script-src-elem", "script-src-attr", "style-src-attr", "connect-src"} <= stopped
