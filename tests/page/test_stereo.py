"""Depth on the page: in a headset that the package iwer emulates in the browser, and side by side for a projector."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.served_picture import drawn, served
from tests.page.test_picture import still
from tests.patience import PATIENCE_S
from tests.visualization.likeness import picture
from trocar.services.supervisor.page.page_place import DIST

EMULATOR = DIST.parent / "node_modules" / "iwer" / "build" / "iwer.min.js"
pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
    pytest.mark.skipif(not EMULATOR.is_file(), reason="the page's packages for development are not installed"),
]
#: A headset before the page is there, at the height of a person who stands. The emulator says of all controllers that
#: their place is guessed, which a headset says of those that it does not see; `guesses` is whether it does.
DEVICE = """
globalThis.guesses = false;
Object.defineProperty(IWER.XRPose.prototype, "emulatedPosition", {get: () => globalThis.guesses});
globalThis.device = new IWER.XRDevice(IWER.metaQuest3, {stereoEnabled: true});
device.installRuntime({forceInstall: true});
device.position.set(0, 1.6, 0);
for (const side of ["left", "right"]) {
  device.controllers[side].connected = true;
  device.controllers[side].position.set(side === "left" ? -0.2 : 0.2, 1.4, -0.4);
}
"""
#: So far outside of the place of a controller of that headset its grip is.
GRIP_M = 0.00398
#: The next two frames of the headset have been drawn.
FRAMES = "new Promise((done) => {{ const s = trocar.stereo.headset.session; let n = {n}; const next = () => (n-- ? s.requestAnimationFrame(next) : done(true)); next(); }})"  # noqa: E501
BUTTON = """[...document.querySelectorAll('[aria-label="Camera"] button')].find((b) => b.textContent === '{name}')"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with served(tmp_path_factory.mktemp("stereo"), *still(), before=EMULATOR.read_text() + DEVICE) as browser:
        yield browser


@pytest.fixture
def inside(page: Chromium) -> Iterator[Chromium]:
    """A page whose headset shows it."""
    page.evaluate("trocar.stereo.told.then(() => 0)")
    assert not page.evaluate(BUTTON.format(name="Headset") + ".disabled")
    page.evaluate(BUTTON.format(name="Headset") + ".click()")
    page.until(lambda: page.evaluate("trocar.view.stage.renderer.xr.isPresenting"), PATIENCE_S, "a session")
    page.evaluate(FRAMES.format(n=3))
    yield page
    if page.evaluate("Boolean(trocar.stereo.headset.session)"):
        page.evaluate("trocar.stereo.headset.session.end()")
    page.until(lambda: not page.evaluate("Boolean(trocar.stereo.headset.session)"), PATIENCE_S, "the end of it")


def _eyes(page: Chromium) -> dict[str, Any]:
    told = page.evaluate(
        """(() => {
          const {stage} = trocar.view, {cameras} = stage.renderer.xr.getCamera();
          return JSON.stringify({
            at: cameras.map((eye) => [...eye.matrixWorld.elements].slice(12, 15)),
            wide: cameras.map((eye) => eye.viewport.z), place: trocar.stereo.headset.place,
          });
        })()"""
    )
    found: dict[str, Any] = json.loads(told)
    return found


def test_both_eyes_see_the_duct_before_them_as_far_apart_as_eyes_are(inside: Chromium) -> None:
    eyes = _eyes(inside)
    apart_mm = np.linalg.norm(np.subtract(*eyes["at"]))
    assert len(eyes["at"]) == 2
    assert min(eyes["wide"]) > 0
    assert apart_mm / eyes["place"]["mmPerMetre"] == pytest.approx(0.063, abs=0.005)
    target = json.loads(inside.evaluate("JSON.stringify(trocar.view.stage.controls.target.toArray())"))
    distance_m = np.linalg.norm(np.mean(eyes["at"], axis=0) - target) / eyes["place"]["mmPerMetre"]
    assert distance_m == pytest.approx(np.hypot(0.15, 0.5), abs=0.02)


def test_the_scope_follows_the_head_and_hands_move_and_scale_the_world(inside: Chromium) -> None:
    start = _eyes(inside)
    inside.evaluate("device.position.set(0.1, 1.6, 0)")
    inside.evaluate(FRAMES.format(n=3))
    moved = np.linalg.norm(np.subtract(_eyes(inside)["at"], start["at"]), axis=1) / start["place"]["mmPerMetre"]
    np.testing.assert_allclose(moved, 0.1, atol=2e-3)
    inside.evaluate("['left', 'right'].forEach((s) => device.controllers[s].updateButtonValue('squeeze', 1))")
    inside.evaluate(FRAMES.format(n=3))
    inside.evaluate("device.controllers.left.position.set(-0.4, 1.4, -0.4)")
    inside.evaluate("device.controllers.right.position.set(0.4, 1.4, -0.4)")
    inside.evaluate(FRAMES.format(n=3))
    place = _eyes(inside)["place"]
    by = (0.4 + 2.0 * GRIP_M) / (0.8 + 2.0 * GRIP_M)
    assert place["mmPerMetre"] == pytest.approx(by * start["place"]["mmPerMetre"], rel=1e-3)
    inside.evaluate("['left', 'right'].forEach((s) => device.controllers[s].updateButtonValue('squeeze', 0))")
    inside.evaluate(
        "['left', 'right'].forEach((s) => device.controllers[s].position.set(s === 'left' ? -0.2 : 0.2, 1.4, -0.4))"
    )
    inside.evaluate("device.position.set(0, 1.6, 0)")


def test_controllers_move_the_instruments_that_were_taken_and_triggers_close_their_jaws(inside: Chromium) -> None:
    inside.evaluate(
        """(() => {
          const hands = globalThis.trocar.hands, shape = trocar.view.stage.layout.tools[0];
          const grip = {name: "right", at: 0, jaws: [0, 0, 40], opening: 1, turned: 0, trigger: 0,
            move(by) { this.jaws = this.jaws.map((x, i) => x + by[i]); return by; }, turn(by) { this.turned += by; },
            jawsOf() { return this.jaws; }};
          Object.assign(hands, {grips: [grip], link: {send() {}, close() {}}});
        })()"""
    )
    inside.evaluate(FRAMES.format(n=2))
    before = json.loads(inside.evaluate("JSON.stringify(trocar.hands.grips[0].jaws)"))
    inside.evaluate("device.controllers.right.position.set(0.2, 1.5, -0.4)")
    inside.evaluate("device.controllers.right.updateButtonValue('trigger', 1)")
    inside.evaluate(FRAMES.format(n=3))
    told = json.loads(
        inside.evaluate("JSON.stringify([trocar.hands.grips[0], trocar.stereo.headset.place.mmPerMetre])")
    )
    grip, mm_per_metre = told
    np.testing.assert_allclose(
        np.subtract(grip["jaws"], before), [0.0, 0.0, 0.1 * mm_per_metre], atol=0.02 * mm_per_metre
    )
    assert grip["opening"] == 0
    inside.evaluate("void Object.assign(trocar.hands, {grips: [], link: null})")
    inside.evaluate("device.controllers.right.updateButtonValue('trigger', 0)")


def test_a_controller_that_the_headset_does_not_see_moves_nothing(inside: Chromium) -> None:
    seen = "JSON.stringify(Object.keys(trocar.stereo.headset.controllers.before))"
    assert json.loads(inside.evaluate(seen)) == ["left", "right"]
    inside.evaluate("globalThis.guesses = true")
    inside.evaluate(FRAMES.format(n=2))
    assert json.loads(inside.evaluate(seen)) == []
    inside.evaluate("globalThis.guesses = false")


def test_after_the_headset_the_page_looks_as_before(page: Chromium) -> None:
    before = picture(drawn(page), (256, 192))
    page.evaluate("trocar.stereo.told.then(() => 0)")
    page.evaluate(BUTTON.format(name="Headset") + ".click()")
    page.until(lambda: page.evaluate("trocar.view.stage.renderer.xr.isPresenting"), PATIENCE_S, "a session")
    page.evaluate(FRAMES.format(n=2))
    page.evaluate(BUTTON.format(name="Headset") + ".click()")
    page.until(lambda: not page.evaluate("Boolean(trocar.stereo.headset.session)"), PATIENCE_S, "the end of it")
    after = picture(drawn(page), (256, 192))
    assert np.abs(np.asarray(after, float) - np.asarray(before, float)).mean() < 1.0


def test_side_by_side_each_half_is_the_picture_of_an_eye_and_the_duct_lies_in_the_screen(page: Chromium) -> None:
    plain = np.asarray(picture(drawn(page), (256, 192)), float)
    page.evaluate(BUTTON.format(name="Side by side") + ".click()")
    both = np.asarray(picture(drawn(page), (512, 192)), float)
    left, right = both[:, :256], both[:, 256:]
    page.evaluate(BUTTON.format(name="Side by side") + ".click()")
    assert np.abs(left - right).mean() > 0.2, "two eyes see the same"
    for half in (left, right):
        assert np.corrcoef(half.ravel(), plain.ravel())[0, 1] > 0.8
    again = np.asarray(picture(drawn(page), (256, 192)), float)
    assert np.abs(again - plain).mean() < 0.5


def test_what_needs_tls_or_a_headset_is_said(page: Chromium) -> None:
    scopes = {
        "{isSecureContext: false, navigator: {}}": "over https",
        "{isSecureContext: true, navigator: {}}": "no WebXR",
        "{isSecureContext: true, navigator: {xr: {isSessionSupported: async () => false}}}": "No headset is connected",
    }
    for scope, said in scopes.items():
        assert said in page.evaluate(f"trocar.stereo.whyNone({scope})")
