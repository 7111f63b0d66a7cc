"""The page on which a person picks: what it shows, saves and refuses."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import forked, scan
from tests.anatomy.volumes import write_volume
from trocar.services.anatomy.edit_page import EditPage
from trocar.services.anatomy.making import AnatomyRequest, MadeAnatomy, make_anatomy
from trocar.services.anatomy.scene_folder import write_folder
from trocar.services.training.scenario import load_scenario

pytest.importorskip("SimpleITK", reason="the scan extra is not installed")
pytest.importorskip("httpx", reason="the test client needs it")


@pytest.fixture(scope="module")
def anatomy(tmp_path_factory: pytest.TempPathFactory) -> MadeAnatomy:
    known = scan(forked(), (0.7, 0.7, 0.7))
    return make_anatomy(write_volume(known, tmp_path_factory.mktemp("scan") / "duct.nrrd"), AnatomyRequest())


class Served:
    def __init__(self, made: MadeAnatomy, files: Path) -> None:
        self.saved: list[MadeAnatomy] = []
        self.page = EditPage(made, self.saved.append, files)

    def ask(self, method: str, path: str, **more: object):
        import httpx

        async def asked():
            transport = httpx.ASGITransport(app=self.page.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
                return await client.request(method, path, **more)

        return asyncio.run(asked())

    def get(self, path: str, token: str | None = None):
        return self.ask("GET", path, params={"token": self.page.token if token is None else token})

    def save(self, **changed: object):
        told = self.get("/api/duct").json()
        picked = {"mouth": told["mouth"], "held": told["held"], "names": {}, "ports_mm": [], "goal_mm": None} | changed
        return self.ask("POST", "/api/save", params={"token": self.page.token}, json=picked)


@pytest.fixture
def served(anatomy: MadeAnatomy, tmp_path: Path) -> Served:
    (tmp_path / "anatomy.html").write_text("<p>page")
    (tmp_path / "secret.txt").write_text("x")
    return Served(anatomy, tmp_path)


def test_only_who_has_the_token_sees_the_duct(served: Served) -> None:
    assert served.get("/").text == "<p>page"
    assert served.get("/api/duct").status_code == 200
    for path in ("/", "/api/duct"):
        assert served.get(path, "wrong").status_code == 403
    assert served.ask("POST", "/api/save", json={}).status_code == 403
    assert served.ask("GET", "/secret.txt").status_code == 404
    assert served.ask("GET", "/", headers={"host": "evil.example:8000"}).status_code == 421


def test_it_shows_the_duct_where_it_lies_in_the_patient(served: Served, anatomy: MadeAnatomy) -> None:
    told = served.get("/api/duct").json()
    assert np.array(told["vertices_mm"]).reshape(-1, 3) == pytest.approx(1e3 * anatomy.duct.mesh.vertices_m, abs=1e-3)
    assert [end["name"] for end in told["ends"]] == ["end_0", "end_1", "end_2"]
    assert told["mouth"] == "end_2"
    for port, scene_m in zip(told["ports_mm"], anatomy.ports_m, strict=True):
        at_m = anatomy.axes @ (1e-3 * np.array(port) - anatomy.origin_m)
        assert at_m == pytest.approx(scene_m, abs=1e-4)


def test_picks_are_saved(served: Served) -> None:
    told = served.get("/api/duct").json()
    names = {"end_0": "common_duct", "end_1": "duodenum", "end_2": "cystic_duct"}
    ports = [[x + 5.0 for x in port] for port in told["ports_mm"]]
    goal = told["lines_mm"][0][10]
    answer = served.save(mouth="end_1", held=["end_0"], names=names, ports_mm=ports, goal_mm=goal)
    assert answer.status_code == 200
    made = served.saved[-1]
    assert (made.choice.mouth, made.choice.held) == ("duodenum", ("common_duct",))
    assert made.names == ["common_duct", "duodenum", "cystic_duct"]
    assert answer.json()["ports_mm"] == pytest.approx(np.array(ports), abs=0.02)
    assert made.goal is not None
    assert 0.0 < made.goal.depth_m < 60e-3
    again = served.save(mouth="cystic_duct", held=["common_duct", "duodenum"])
    assert again.status_code == 200
    assert served.saved[-1].choice.mouth == "cystic_duct"


def test_a_goal_becomes_a_scenario_that_can_be_run(served: Served, tmp_path: Path) -> None:
    told = served.get("/api/duct").json()
    assert served.save(goal_mm=told["lines_mm"][0][6]).status_code == 200
    made = served.saved[-1]
    write_folder(made, tmp_path / "made")
    scenario = load_scenario(tmp_path / "made" / "scenario.yaml")
    assert made.goal is not None
    assert (scenario.goal.branch, scenario.goal.depth_m) == (made.goal.end, made.goal.depth_m)
    assert Path(scenario.scene) == tmp_path / "made" / "scene.yaml"
    write_folder(replace(made, goal=None), tmp_path / "made")
    assert not (tmp_path / "made" / "scenario.yaml").exists()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"mouth": "end_9"}, "has no end 'end_9'"),
        ({"mouth": "end_0", "held": ["end_0"]}, "cannot be the mouth and held"),
        ({"names": {"end_0": "two words"}}, "plain word"),
        ({"ports_mm": [[1, 2]]}, ""),
        ({"goal_mm": [1e9, 0, 0]}, "no place"),
        ({"held": None}, ""),
    ],
)
def test_picks_that_cannot_be_are_refused_and_nothing_is_lost(served: Served, changed: dict, told: str) -> None:
    before = served.get("/api/duct").json()
    answer = served.save(**changed)
    assert answer.status_code == 422
    assert told in answer.json()["refused"]
    assert not served.saved
    assert served.get("/api/duct").json() == before
