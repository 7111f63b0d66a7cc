"""The certificate of the page: who makes it, what it says, and what is refused without it."""

from __future__ import annotations

import datetime
import json
import ssl
import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from trocar.services.cli.app import app
from trocar.services.runtime.bus import keys
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.web import web_certificate
from trocar.services.runtime.web.web_certificate import load, make, own_names

BEYOND = [
    ("supervisor.web.host=0.0.0.0",),
    ("supervisor.web.host='::'",),
    ("supervisor.web.host=192.168.1.11",),
    ("visualization.host=bench-1.local",),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make(tmp_path / "keys", own_names())
    return tmp_path / "keys"


@pytest.mark.parametrize("overrides", BEYOND)
def test_beyond_loopback_the_page_is_encrypted_or_said_to_be_open(overrides: tuple[str, ...], folder: Path) -> None:
    """The token went over a classroom's network in clear, and nothing said so."""
    with pytest.raises(ConfigError, match=r"over the network in clear.*supervisor\.web\.keys.*insecure: true"):
        config.load_rig("stub", overrides)
    config.load_rig("stub", (*overrides, "supervisor.web.insecure=true"))
    config.load_rig("stub", (*overrides, f"supervisor.web.keys={folder}"))


def test_a_picture_that_nobody_serves_needs_none() -> None:
    rig = config.load_rig("stub", ("visualization.host=0.0.0.0", "visualization.viewer=native"))
    assert (rig.visualization.host, rig.supervisor.web.keys) == ("0.0.0.0", None)


def test_the_verb_makes_keys_and_certificate_once(tmp_path: Path) -> None:
    made = CliRunner().invoke(app, ["keys", str(tmp_path / "keys"), "--name", "bench-1.lab", "--json"])
    said = json.loads(made.stdout)
    assert {"bench-1.lab", "localhost", "127.0.0.1"} <= set(said["names"])
    assert load(tmp_path / "keys").fingerprint == said["fingerprint"]
    keys.load(tmp_path / "keys")
    again = CliRunner().invoke(app, ["keys", str(tmp_path / "keys")])
    assert "is there already" in str(again.exception)


def test_keys_of_an_older_version_get_a_certificate(tmp_path: Path) -> None:
    before = keys.load(keys.make(tmp_path).parent)
    assert CliRunner().invoke(app, ["keys", str(tmp_path)]).exit_code == 0
    assert keys.load(tmp_path) == before
    load(tmp_path)


def test_the_key_is_private_and_the_certificate_says_for_whom_and_until_when(folder: Path) -> None:
    assert stat.S_IMODE((folder / "page.key_secret").stat().st_mode) == 0o600
    context = ssl.create_default_context(cafile=str(folder / "page.crt"))
    assert context.check_hostname
    left = load(folder).until - datetime.datetime.now(datetime.UTC)
    assert datetime.timedelta(days=820) < left < web_certificate.VALID


@pytest.mark.parametrize("name", ["", "a b", "x;y", "*", ".lab", "a" * 70])
def test_a_name_that_no_host_can_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="neither a host's name nor an address"):
        make(tmp_path, [name])


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("missing", "No such file or directory; `trocar keys` makes it"),
        ("open", "can be read by others"),
        ("other key", "are no pair"),
        ("nonsense", "holds no certificate"),
        ("expired", "was valid until"),
    ],
)
def test_what_cannot_serve_is_one_sentence(
    folder: Path, tmp_path: Path, fault: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, certificate = folder / "page.key_secret", folder / "page.crt"
    match fault:
        case "missing":
            certificate.unlink()
        case "open":
            key.chmod(0o644)
        case "other key":
            make(tmp_path / "other", ["localhost"])
            key.write_bytes((tmp_path / "other" / "page.key_secret").read_bytes())
        case "nonsense":
            certificate.write_text("nonsense")
        case "expired":
            key.unlink()
            certificate.unlink()
            monkeypatch.setattr(web_certificate, "VALID", datetime.timedelta(hours=1))
            with pytest.raises(ConfigError, match=says):
                make(folder, ["localhost"])
    with pytest.raises(ConfigError, match=says):
        load(folder)
