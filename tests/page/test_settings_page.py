"""Settings at the page, by mouse and keyboard: a file is changed and saved only when sound, devices, disk and logs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import chromium
from tests.page.looks import LOOKS, Look, cut_words, keep_picture, looked_at, serious_faults, set_language
from tests.page.school_page import SchoolPage, school_page
from tests.page.test_school_page import arrive
from trocar.services.supervisor.page.page_place import DIST

pytestmark = [
    pytest.mark.timeout(900),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]
_SAID = "(document.getElementById('file-said')?.textContent ?? '')"
_CUT = """[...document.querySelectorAll('#sheet button, #sheet select, #sheet input')].filter((node) => {
  const { x, width } = node.getBoundingClientRect();
  return width && !node.closest('.scroll') && (x < 0 || x + width > innerWidth + 1);
}).map(({ id }) => id)"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("settings")


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[SchoolPage]:
    with school_page(folder) as page:
        (folder / "recordings").mkdir()
        (folder / "recordings" / "20261130-one.mcap").write_bytes(b"x" * 123_000)
        logs = folder / "bus" / "log"
        logs.mkdir(mode=0o700)
        (logs / "physics.log").write_text("physics: it began\n")
        yield page


def open_settings(page: SchoolPage, tab: str = "files") -> None:
    arrive(page, "engineer")
    page.press("#settings-open")
    page.until("document.getElementById('file-name')?.options.length > 0", "the files are listed")
    if tab != "files":
        page.press(f"#settings-{tab}")


def choose(page: SchoolPage, selector: str, value: str) -> None:
    """Choose in a list, or type into a field, as a person does."""
    page.browser.evaluate(
        f"(() => {{ const node = document.querySelector({selector!r}); node.value = {value!r};"
        "for (const kind of ['input', 'change']) node.dispatchEvent(new Event(kind, {bubbles: true})); })()"
    )


def open_touch(page: SchoolPage) -> None:
    open_settings(page)
    page.until(f"{_SAID} === 'As it is kept.'", "the rig's file is sound")
    choose(page, "#file-kind", "device")
    page.until("document.querySelector('#file-name option[value=touch]') !== null", "the devices")
    choose(page, "#file-name", "touch")
    page.until("document.getElementById('file-text').value.includes('model: Touch')", "the file")
    page.until("document.querySelector('[aria-label=max_force_n]') !== null", "its keys")


def test_the_file_of_the_rig_that_runs_is_shown_with_what_each_key_means(page: SchoolPage) -> None:
    open_settings(page)
    page.until(f"{_SAID} === 'As it is kept.'", "the rig's file is sound")
    assert (
        page.browser.evaluate("document.getElementById('file-name').selectedOptions[0].textContent") == "mouse (runs)"
    )
    choose(page, "#file-find", "core")
    shown = "[...document.querySelectorAll('.keys-table tbody tr')].filter((row) => !row.hidden)"
    keys = page.browser.evaluate(f"{shown}.map((row) => row.firstChild.textContent)")
    assert "processes.gateway.core" in keys
    assert all("core" in key or "core" in page.browser.text(".keys-table") for key in keys)


def test_a_value_is_changed_and_saved_and_a_wrong_one_is_refused_with_its_key(page: SchoolPage, folder: Path) -> None:
    path = folder / "configs" / "devices" / "touch.yaml"
    before = path.read_text()
    open_touch(page)
    choose(page, "[aria-label=max_force_n]", "900")
    page.until(f"{_SAID}.startsWith('touch.yaml: arm.max_force_n: 900 N is more than 50 N')", "it is refused")
    page.press("#file-save")
    page.until(f"{_SAID}.startsWith('touch.yaml: arm.max_force_n')", "it is refused again")
    assert path.read_text() == before
    choose(page, "[aria-label=max_force_n]", "2.9")
    page.until(f"{_SAID} === 'Sound, and not saved yet.'", "it is sound")
    page.press("#file-save")
    page.until(f"{_SAID}.startsWith('Saved.')", "it is saved")
    changed = path.read_text().splitlines()
    [line] = [new for new, old in zip(changed, before.splitlines(), strict=True) if new != old]
    assert line.startswith("max_force_n: 2.9 ")
    assert "vendor's data sheet" in line, "a remark stays"
    assert page.bench.journal.last()[0]["name"] == "touch"


def test_a_file_is_saved_under_a_new_name(page: SchoolPage, folder: Path) -> None:
    open_touch(page)
    choose(page, "#file-other", "our-touch")
    page.press("#file-as")
    page.until("document.getElementById('file-name').value === 'our-touch'", "it is there, and open")
    assert (folder / "configs" / "devices" / "our-touch.yaml").is_file()
    page.until("!document.getElementById('file-as').disabled", "it has come to its end")
    choose(page, "#file-other", "../out")
    page.press("#file-as")
    page.until(f"{_SAID}.includes('is no name of a file')", "no name leads out of the folder")


def test_the_rig_is_started_anew_and_the_page_follows(page: SchoolPage) -> None:
    open_settings(page)
    page.until(f"{_SAID} === 'As it is kept.'", "the rig's file is sound")
    page.asked.clear()
    page.press("#file-start")
    page.until(f"{_SAID} === 'The rig begins anew…'", "it is checked and asked for")
    assert [each.what for each in page.asked] == ["restart"]
    page.browser.evaluate("globalThis.stayed = true; trocar.settings.update({incarnation: -1})")
    page.until("globalThis.stayed === undefined", "the page is loaded anew with the new run")


def test_devices_disk_and_logs_are_shown(page: SchoolPage) -> None:
    open_settings(page, "disk")
    page.until("document.querySelector('#sheet-body').innerText.includes('123 kB in 1 recordings')", "the recordings")
    assert "20261130-one.mcap" in page.browser.text("#sheet-body")
    page.press("#settings-logs")
    page.until("document.querySelector('pre.log')?.textContent === 'physics: it began\\n'", "the log")
    page.press("#settings-devices")
    page.press("#devices-check")
    page.until("document.querySelectorAll('.checks li').length > 3", "what the host says")


def see(page: SchoolPage, done: int, newton: float = 0.0, *, place: int = 0, stopped: bool = False) -> None:
    """Show the left arm's felt test what is there, until so many steps are done."""
    now = (
        f"trocar.settings.devices.view = () => ({{felt: [{newton}, 0], placeOf: () => [{place}, {place}, {place}]}});"
        "trocar.settings.devices.update({processes: [{name: 'gateway', gauges: {'arm_calibrated.left': 1}}],"
        f"state: 'running', safe_stop: {str(stopped).lower()}}})"
    )
    page.browser.evaluate(now)
    page.until(f"document.querySelectorAll('.steps li[data-state=done]').length === {done}", f"{done} steps are done")


def test_an_arms_felt_test_is_answered_by_a_person_and_kept_in_the_journal(page: SchoolPage) -> None:
    open_settings(page, "devices")
    page.press("[data-arm=left]")
    page.until("document.querySelectorAll('.steps li').length === 6", "the steps of the felt test")
    see(page, 1)
    see(page, 1)
    see(page, 1, place=25)
    page.press("#felt-yes")
    see(page, 3)
    see(page, 3, 0.3)
    page.press("#felt-yes")
    see(page, 5)
    see(page, 5, 0.3)
    see(page, 5, 0.3, stopped=True)
    page.press("#felt-no")
    page.until("document.querySelector('.felt-arms li').dataset.result === 'failed'", "the result is told")
    assert "the hand did not go limp" in page.browser.text(".felt-arms li")
    act = page.bench.journal.last()[0]
    assert (act["act"], act["arm"], act["passed"], act["step"]) == ("felt test", "left", False, "stop")
    assert page.browser.evaluate("document.querySelectorAll('.felt-arms li')[1].dataset.result") == "none"


def test_a_trainee_sees_no_settings(page: SchoolPage) -> None:
    arrive(page)
    assert not page.sees("#settings-open")


@pytest.mark.parametrize("look", LOOKS, ids=str)
def test_nothing_is_cut_and_axe_finds_nothing(page: SchoolPage, look: Look) -> None:
    browser = page.browser
    if not browser.evaluate("Boolean(globalThis.trocar)"):
        open_settings(page)
    if look.language != browser.evaluate("document.documentElement.lang"):
        set_language(browser, look.language)
        open_settings(page)
    try:
        with looked_at(browser, look):
            if not page.sees("#settings-files"):
                open_settings(page)
            page.press("#settings-files")
            page.until("document.querySelectorAll('.keys-table tbody tr').length > 0", "the rig's file is shown")
            for tab in ("files", "devices", "disk", "logs"):
                page.press(f"#settings-{tab}")
                time.sleep(1.0)
                if tab == "devices":
                    page.press("[data-arm=left]")
                assert browser.evaluate(_CUT) == [], tab
                assert cut_words(browser) == [], tab
                assert browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, tab
                assert serious_faults(browser) == [], tab
                keep_picture(browser, f"settings-{tab}-{look}")
    finally:
        set_language(browser, "en")
