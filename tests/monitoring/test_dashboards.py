"""Grafana's files against Grafana's own schema: the models of its foundation SDK.

A model keeps what it knows and drops the rest: what does not come back is no field of Grafana's.
"""

from __future__ import annotations

import copy
import json
import os
import subprocess
import warnings
from collections import Counter
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import yaml
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.cog.plugins import register_default_plugins

from tests.monitoring.exporter import DASHBOARDS, FOLDER, ROOT

with warnings.catch_warnings():
    # The classic model is what files hold that every Grafana takes; for programs the SDK now prefers another.
    warnings.filterwarnings("ignore", "Prefer using dashboardv2", DeprecationWarning)
    from grafana_foundation_sdk.models.dashboard import Dashboard

    register_default_plugins()
_PROVISIONING = FOLDER / "grafana" / "provisioning"


def _load(file: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(file.read_text())
    return loaded


def _returned(dashboard: dict[str, Any]) -> Any:
    return json.loads(JSONEncoder().encode(Dashboard.from_json(dashboard)))


def _unknown(given: Any, back: Any, at: str = "") -> Iterator[str]:
    """Yield the places of what did not come back as it was."""
    if isinstance(given, dict):
        for key, value in given.items():
            if isinstance(back, dict) and key in back:
                yield from _unknown(value, back[key], f"{at}.{key}")
            else:
                yield f"{at}.{key}"
    elif isinstance(given, list) and isinstance(back, list) and len(given) == len(back):
        for k, (one, other) in enumerate(zip(given, back, strict=True)):
            yield from _unknown(one, other, f"{at}[{k}]")
    elif given != back:
        yield at


@pytest.mark.parametrize("file", DASHBOARDS, ids=lambda file: file.stem)
def test_grafana_knows_every_field(file: Path) -> None:
    dashboard = _load(file)
    assert list(_unknown(dashboard, _returned(dashboard))) == []


@pytest.mark.parametrize("place", ["colour", "targets.0.exprs", "options.legends", "fieldConfig.defaults.units"])
def test_a_field_that_grafana_does_not_know_is_found(place: str) -> None:
    dashboard = copy.deepcopy(_load(FOLDER / "grafana" / "dashboards" / "rig.json"))
    panel = at = next(each for each in dashboard["panels"] if each["type"] == "timeseries")
    *path, name = place.split(".")
    for step in path:
        at = at[int(step)] if step.isdigit() else at[step]
    at[name] = "x"
    found = list(_unknown(dashboard, _returned(dashboard)))
    assert found == [f".panels[{dashboard['panels'].index(panel)}].{place.replace('.0.', '[0].')}"]


@pytest.mark.parametrize("file", DASHBOARDS, ids=lambda file: file.stem)
def test_panels_are_told_apart_do_not_overlap_and_ask_the_provisioned_source(file: Path) -> None:
    dashboard = _load(file)
    [source] = yaml.safe_load((_PROVISIONING / "datasources" / "trocar.yml").read_text())["datasources"]
    asked = {"type": source["type"], "uid": source["uid"]}
    assert max(Counter(panel["id"] for panel in dashboard["panels"]).values()) == 1
    taken: Counter[tuple[int, int]] = Counter()
    for panel in dashboard["panels"]:
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24
        columns, rows = (range(place[a], place[a] + place[b]) for a, b in (("x", "w"), ("y", "h")))
        taken.update((x, y) for x in columns for y in rows)
        if panel["type"] != "row":
            assert panel["datasource"] == asked
            assert all(target["datasource"] == asked for target in panel.get("targets", ()))
    assert max(taken.values()) == 1
    assert dashboard["uid"] == f"trocar-{file.stem}"


def test_what_is_provisioned_lies_where_compose_mounts_it() -> None:
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    [provider] = yaml.safe_load((_PROVISIONING / "dashboards" / "trocar.yml").read_text())["providers"]
    mounts = dict(mount.split(":")[:2] for mount in services["grafana"]["volumes"])
    where = {inside: outside for outside, inside in mounts.items()}
    assert where[provider["options"]["path"]] == "./deploy/monitoring/grafana/dashboards"
    assert where["/etc/grafana/provisioning"] == "./deploy/monitoring/grafana/provisioning"
    home = services["grafana"]["environment"]["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"]
    assert home.startswith(provider["options"]["path"])
    assert (FOLDER / "grafana" / "dashboards" / Path(home).name).exists()


def test_the_schema_is_newer_than_those_that_end_with_grafana_11() -> None:
    """Versions with an epoch carry Grafana's in their name, and the last is 11.6; since then there is one for all."""
    image = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]["grafana"]["image"]
    assert "!" not in metadata.version("grafana-foundation-sdk")
    assert int(image.removesuffix("}").rpartition(":")[2].split(".")[0]) >= 13


_PANELS_OF_13 = {"alertlist", "heatmap", "row", "stat", "table", "timeseries"}


@pytest.mark.parametrize("file", DASHBOARDS, ids=lambda file: file.stem)
def test_panels_are_of_kinds_that_grafana_still_has(file: Path) -> None:
    """Angular panels (graph, singlestat, table-old) are gone since Grafana 12."""
    assert {panel["type"] for panel in _load(file)["panels"]} <= _PANELS_OF_13


def _start(folder: Path, password: str | None, secret: str | None) -> subprocess.CompletedProcess[str]:
    """Start the container's script with another one in the place of Grafana's own."""
    grafana = folder / "run.sh"
    grafana.write_text('#!/bin/sh\necho "$GF_SECURITY_ADMIN_PASSWORD:${GRAFANA_PASSWORD-unset}"\n')
    grafana.chmod(0o755)
    environment = {"PATH": os.environ["PATH"], "GRAFANA_RUN": str(grafana), "GRAFANA_SECRET": str(folder / "secret")}
    if password is not None:
        environment["GRAFANA_PASSWORD"] = password
    if secret is not None:
        (folder / "secret").write_text(secret)
    script = ["sh", str(FOLDER / "grafana" / "start")]
    return subprocess.run(script, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("password", "secret"), [(None, None), ("", None), ("", ""), (None, "\n"), ("admin", None), (None, "admin\n")]
)
def test_grafana_does_not_start_without_a_password_of_the_lab(
    tmp_path: Path, password: str | None, secret: str | None
) -> None:
    ran = _start(tmp_path, password, secret)
    assert (ran.returncode, ran.stdout) == (78, "")
    assert ran.stderr.startswith("grafana: set GRAFANA_PASSWORD, or GRAFANA_PASSWORD_FILE ")
    assert len(ran.stderr.splitlines()) == 1


@pytest.mark.parametrize(("password", "secret"), [("of $ours", None), ("", "of $ours\n"), ("of $ours", "another")])
def test_grafana_starts_with_the_password_of_the_lab(tmp_path: Path, password: str, secret: str | None) -> None:
    ran = _start(tmp_path, password, secret)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "of $ours:unset\n", "")


def test_nobody_looks_without_an_account_nor_from_another_host() -> None:
    """It was anonymous with admin/admin, at a version with public advisories."""
    text = (ROOT / "docker-compose.yml").read_text()
    grafana = yaml.safe_load(text)["services"]["grafana"]
    assert grafana["environment"]["GF_AUTH_ANONYMOUS_ENABLED"] == "false"
    assert grafana["environment"]["GRAFANA_PASSWORD"] == "${GRAFANA_PASSWORD:-}"
    assert "GF_SECURITY_ADMIN_PASSWORD" not in text, "only the script sets it"
    assert grafana["entrypoint"] == ["/bin/sh", "/etc/trocar/start"]
    assert "./deploy/monitoring/grafana/start:/etc/trocar/start:ro" in grafana["volumes"]
    assert all(port.startswith("127.0.0.1:") for port in grafana["ports"])
