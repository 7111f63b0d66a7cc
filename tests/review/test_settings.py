"""Settings at the page: files change where they are meant to, are checked before they are written, and never half."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.review.class_of_pages import served
from trocar.review.school.answering import ROLE
from trocar.review.school.app import build_app
from trocar.review.school.bench import Bench
from trocar.review.school.settings_routes import EditableSettings
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.review.settings.yaml_edit import with_value
from trocar.services.runtime.config import config, yaml_text
from trocar.services.runtime.errors import ConfigError

CONFIGS = config.config_directory()
FILES = [path for kind in ("rigs", "scenes", "devices") for path in sorted((CONFIGS / kind).glob("*.yaml"))]
TEXT = """\
# A rig.
name: mine # by hand
gateway:
  instruments:
    - {name: left, arm: {driver: mouse}} # a remark on it
    - name: right
      arm: {driver: mouse, settings: {speed: 1.0e-3}}

  # The end of the gateway.
scene: default
empty:
"""
REMARK = " # a remark on it"


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("name", "ours", "name: ours # by hand"),
        ("gateway.instruments.0.name", "one", f"    - {{name: one, arm: {{driver: mouse}}}}{REMARK}"),
        ("gateway.instruments.0.arm.device", "x", f"    - {{name: left, arm: {{driver: mouse, device: x}}}}{REMARK}"),
        ("gateway.instruments.1.arm.settings.speed", "2e-3", "      arm: {driver: mouse, settings: {speed: 2e-3}}"),
        ("gateway.rate_hz", "500", "  rate_hz: 500"),
        ("recorder.disk.most", "[1, 2]", "recorder: {disk: {most: [1, 2]}}"),
        ("empty", "3", "empty: 3"),
        ("empty.below", "true", "empty: {below: true}"),
        ("scene", "'a, b: c'", "scene: 'a, b: c'"),
    ],
)  # fmt: skip
def test_one_value_is_changed_and_nothing_else(key: str, value: str, line: str) -> None:
    changed = with_value(TEXT, key, value)
    assert line in changed.splitlines()
    expected = yaml_text.read(TEXT)
    expected["empty"] = {} if key == "empty.below" else None
    config.apply_overrides(expected, [f"{key}={value}"], {})
    assert yaml_text.read(changed) == expected
    gone = [each for each in TEXT.splitlines() if each not in changed.splitlines()]
    assert len(gone) <= 1, "one line at most is another"


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_value_of_every_shipped_file_can_be_set_alone(path: Path) -> None:
    text = path.read_text()

    def leaves(value: Any, prefix: str) -> Iterator[str]:
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, item in items:
            yield from leaves(item, f"{prefix}{key}.")
        if not isinstance(value, dict | list):
            yield prefix[:-1]

    for key in leaves(yaml_text.read(text), ""):
        changed = with_value(text, key, "12345").splitlines()
        assert sum(one != other for one, other in zip(changed, text.splitlines(), strict=True)) == 1, key


@pytest.mark.parametrize("value", ["{", "a: b: c", "[1"])
def test_what_is_no_value_is_refused_with_its_key(value: str) -> None:
    with pytest.raises(ConfigError, match=r"^(--set )?scene"):
        with_value(TEXT, "scene", value)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a configuration folder with a few files."""
    made = tmp_path / "configs"
    for kind, names in {"rigs": ("mouse", "stub"), "scenes": ("default",), "devices": ("touch",)}.items():
        (made / kind).mkdir(parents=True)
        for name in names:
            shutil.copy(CONFIGS / kind / f"{name}.yaml", made / kind)
    return made


@pytest.fixture
def files(folder: Path) -> ConfigurationFiles:
    return ConfigurationFiles(folder)


def _state(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("kind", "name", "key", "value", "told"),
    [
        ("device", "touch", "max_force_n", "900", r"^touch\.yaml: arm\.max_force_n: 900 N is more than 50 N"),
        ("device", "touch", "max_forze_n", "3", r"^touch\.yaml: arm\.max_forze_n: unknown key"),
        ("scene", "default", "duct.thickness_m", "thick", r"^default\.yaml: duct\.thickness_m: "),
        ("rig", "mouse", "supervisor.web.port", "-1", r"^mouse\.yaml.*: supervisor\.web\.port: "),
        ("rig", "mouse", "base", "nothing", r"^mouse\.yaml: base: there is no rig"),
    ],
)
def test_what_is_not_sound_is_one_sentence_with_the_key_and_changes_no_file(
    files: ConfigurationFiles, folder: Path, kind: str, name: str, key: str, value: str, told: str
) -> None:
    text, mark = files.read(kind, name)
    before = _state(folder)
    with pytest.raises(ConfigError, match=told) as refused:
        files.save(kind, name, with_value(text, key, value), mark)
    assert "\n" not in str(refused.value)
    assert _state(folder) == before


def test_a_sound_change_is_written_with_its_comments_and_the_rows_say_what_holds(
    files: ConfigurationFiles, folder: Path
) -> None:
    text, mark = files.read("device", "touch")
    changed = with_value(text, "max_force_n", "2.5")
    mark, rows = files.save("device", "touch", changed, mark)
    assert (folder / "devices" / "touch.yaml").read_text() == changed
    by_key = {row["key"]: row for row in rows}
    assert (by_key["max_force_n"]["value"], by_key["max_force_n"]["from"]) == (2.5, "file")
    assert by_key["device_centre_m"]["from"] == ""
    assert by_key["friction_n"]["about"].startswith("friction at the tip")
    assert {path.name for path in (folder / "devices").iterdir()} == {"touch.yaml"}, "no draft is left"
    files.save("device", "mine", changed, "")
    assert files.names()["device"] == ["mine", "touch"]


def test_the_rows_of_a_rig_say_what_comes_from_its_base(files: ConfigurationFiles) -> None:
    rows = {row["key"]: row for row in files.check("rig", "mouse", files.read("rig", "mouse").text)}
    assert (rows["name"]["from"], rows["transport.kind"]["from"], rows["transport.base_port"]["from"]) == (
        "file", "stub.yaml", "",
    )  # fmt: skip
    assert rows["transport.kind"]["kind"] == "choice"
    assert set(rows["transport.kind"]["choices"]) == {"ipc", "tcp"}
    assert rows["processes.gateway.enabled"]["kind"] == "boolean"


def test_a_file_that_another_has_changed_meanwhile_is_not_overwritten(files: ConfigurationFiles, folder: Path) -> None:
    text, mark = files.read("device", "touch")
    (folder / "devices" / "touch.yaml").write_text(text + "# by another\n")
    for given, told in ((mark, "changed by somebody else"), ("", "is there already")):
        with pytest.raises(ConfigError, match=told):
            files.save("device", "touch", text, given)
    assert (folder / "devices" / "touch.yaml").read_text().endswith("# by another\n")


@pytest.mark.parametrize("name", ["../scenes/default", "/etc/passwd", "..", "", "a/b", "a.yaml", ".a", "x" * 65, "a\0"])
def test_no_name_leads_out_of_the_folder(files: ConfigurationFiles, name: str) -> None:
    for act in (lambda: files.read("scene", name), lambda: files.save("scene", name, "duct: {}\n", "")):
        with pytest.raises(ConfigError, match="is no name of a file"):
            act()


def test_no_link_leads_out_of_the_folder(files: ConfigurationFiles, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "secret.yaml").write_text("key: secret\n")
    (folder / "scenes" / "out.yaml").symlink_to(tmp_path / "secret.yaml")
    with pytest.raises(ConfigError, match="leads out of the configuration folder"):
        files.read("scene", "out")
    with pytest.raises(ConfigError, match="there is no kind of file"):
        files.read("script", "stroke")


@pytest.fixture
def client(folder: Path, tmp_path: Path) -> Iterator[httpx.Client]:
    places = (f"transport.directory={tmp_path / 'bus'}", f"recorder.directory={tmp_path / 'rec'}")
    rig = config.load_rig("mouse", places)
    (tmp_path / "bus").mkdir(mode=0o700)
    (tmp_path / "bus" / "log").mkdir(mode=0o700)
    (tmp_path / "bus" / "log" / "physics.log").write_text("it began\n")
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "one.mcap").write_bytes(b"x" * 1000)
    settings = EditableSettings(ConfigurationFiles(folder), Host(rig, ("mouse", ()), "default"))
    app, headers = build_app(Bench(str(tmp_path / "a.sqlite")), settings), {ROLE: "instructor"}
    with served(app) as [address], httpx.Client(base_url=address, timeout=PATIENCE_S, headers=headers) as client:
        yield client


_GET = ["", "/logs", "/logs/physics.log", "/disk", "/devices", "/felt", "/files/rig/mouse"]
_POST = ["/check", "/edit", "/save", "/start", "/felt"]


@pytest.mark.parametrize(("method", "path"), [*(("GET", path) for path in _GET), *(("POST", path) for path in _POST)])
def test_a_trainee_may_do_none_of_it(client: httpx.Client, method: str, path: str) -> None:
    said = client.request(method, f"/settings{path}", headers={ROLE: "trainee"})
    assert said.status_code == 403


def _json(said: httpx.Response) -> Any:
    assert said.status_code == 200, said.text
    return said.json()


def test_logs_and_disk_are_told(client: httpx.Client) -> None:
    [log] = _json(client.get("/settings/logs"))
    assert (log["name"], log["bytes"]) == ("physics.log", 9)
    assert _json(client.get("/settings/logs/physics.log"))["text"] == "it began\n"
    assert client.get("/settings/logs/..%2Fpage.json").status_code in (404, 409)
    disk = _json(client.get("/settings/disk"))
    assert (disk["bytes"], [each["name"] for each in disk["files"]]) == (1000, ["one.mcap"])
    assert 0 < disk["free"] <= disk["total"]


def test_a_file_is_opened_edited_and_saved_and_the_act_is_in_the_journal(client: httpx.Client, folder: Path) -> None:
    found = _json(client.get("/settings"))
    assert found["files"]["device"] == ["touch"]
    assert [each["name"] for each in found["running"]["instruments"]] == ["left", "right"]
    opened = _json(client.get("/settings/files/device/touch"))
    body = {"text": opened["text"], "key": "max_force_n", "value": "3.0"}
    text = _json(client.post("/settings/edit", json=body))["text"]
    body = {"kind": "device", "name": "touch", "text": text, "mark": opened["mark"], "by": "an engineer"}
    _json(client.post("/settings/save", json=body))
    assert "max_force_n: 3.0" in (folder / "devices" / "touch.yaml").read_text()
    act = _json(client.get("/journal"))[0]
    assert (act["act"], act["name"], act["by"]) == ("settings", "touch", "an engineer")
    said = client.post("/settings/save", json={**body, "text": "kind: arm\n"})
    assert said.status_code == 409
    assert "changed by somebody else" in said.json()["error"]


def test_a_start_is_checked_before_the_rig_is_ended(client: httpx.Client) -> None:
    assert _json(client.post("/settings/start", json={})) == {"ok": True}


def test_each_arms_felt_test_is_an_act_in_the_journal_and_its_newest_is_told(client: httpx.Client) -> None:
    assert _json(client.get("/settings/felt")) == {}
    for name, passed, step in (
        ("left", False, "force"),
        ("right", True, ""),
        ("left", True, ""),
        ("left", False, "stop"),
    ):
        _json(client.post("/settings/felt", json={"name": name, "value": passed, "key": step, "by": "an engineer"}))
    found = _json(client.get("/settings/felt"))
    assert {name: (each["passed"], each["step"]) for name, each in found.items()} == {
        "left": (False, "stop"),
        "right": (True, ""),
    }
    acts = _json(client.get("/journal"))
    assert [(act["act"], act["arm"], act["by"]) for act in acts[1:3]] == [
        ("felt test", "left", "an engineer"),
        ("felt test", "right", "an engineer"),
    ]


@pytest.mark.parametrize(
    "body",
    [
        {"name": "third", "value": True},
        {"name": "left", "value": "yes"},
        {"name": "left", "value": True, "key": "force"},
        {"name": "left", "value": False},
        {"name": "left", "value": False, "key": "calibrated"},
    ],
)
def test_a_felt_test_that_no_arm_can_have_had_is_refused(client: httpx.Client, body: dict[str, Any]) -> None:
    assert client.post("/settings/felt", json=body).status_code == 409
    assert _json(client.get("/journal")) == []
