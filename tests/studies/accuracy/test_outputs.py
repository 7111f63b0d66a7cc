"""Table, figures and page of a run."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALLEST

from tests import chromium
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.figures import draw_study
from trocar.studies.accuracy.frontier import frontier
from trocar.studies.accuracy.page import Text, held_figure, write_page
from trocar.studies.accuracy.report import page_of, slower_machine, write_report
from trocar.studies.accuracy.sections import read_section, write_section
from trocar.studies.accuracy.study import Cost, Row
from trocar.studies.accuracy.sweeps import mesh, modes
from trocar.studies.commands import study as command
from trocar.studies.commands.study import write_results

ROOT = Path(__file__).resolve().parents[3]


def some_rows():
    choices = {"duct.n_modes": 20, "note": "</script><b>"}
    return [
        Row("modes", name, "residual", quantity, error, "%", cost=Cost(us, 2 * us, 1.0), choices=choices)
        for quantity in ("force", "motion")
        for name, error, us in (("20 modes", 1.0 / 3.0, 100.0), ("40 modes", 0.0, 150.0), ("60 modes", 0.5, 160.0))
    ]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("written")
    facts = Facts.collect("trocar study modes --quick --seed 1", "abc", SMALLEST, {"modes": Cost(100.0, 120.0, 1.0)})
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(modes, "findings", lambda rows: [f"{len(rows)} rows were read."])
        write_results(some_rows(), ["modes"], facts, tmp_path)
    return tmp_path


def test_the_table_tells_errors_to_the_last_digit_and_who_is_on_the_frontier(written):
    with (written / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["error"]) == 1.0 / 3.0
    assert [r["on_frontier"] for r in rows] == ["1", "1", "0"] * 2
    assert json.loads(rows[0]["choices"])["duct.n_modes"] == 20


def test_figures_are_there_and_the_same_for_the_same_numbers(written, tmp_path_factory, monkeypatch):
    monkeypatch.setattr(modes, "findings", lambda _: [])
    again = tmp_path_factory.mktemp("again")
    write_results(some_rows(), ["modes"], Facts.collect("", "abc", SMALLEST, {}), again)
    assert (written / "modes.png").read_bytes().startswith(b"\x89PNG")
    assert (written / "modes.svg").read_bytes() == (again / "modes.svg").read_bytes()


def test_what_is_right_everywhere_is_drawn_too(tmp_path):
    draw_study("right", [replace(row, error=0.0) for row in some_rows()], tmp_path / "right")
    assert (tmp_path / "right.svg").is_file()


def test_the_run_is_told_with_seed_versions_machine_and_command(written):
    told = json.loads((written / "run.json").read_text())
    assert told["command"] == "trocar study modes --quick --seed 1"
    assert told["seed"] == 1
    assert "numpy" in told["packages"]
    assert re.search(r" cores, load \d+\.\d$", told["machine"])
    assert told["floors"]["modes"]


def test_how_far_the_machine_drifted_over_a_run_is_told_beside_each_of_its_studies(tmp_path, monkeypatch):
    floors = {"modes": Cost(100.0, 120.0, 1.0), "mesh": Cost(110.0, 120.0, 1.0), "paper": Cost(98.0, 120.0, 1.0)}
    facts = Facts.collect("trocar study all", "abc", SMALLEST, floors)
    assert facts.drift_percent == pytest.approx(6.0)
    monkeypatch.setattr(modes, "findings", lambda _: [])
    (tmp_path / "modes.svg").write_text("")
    write_report(some_rows(), ["modes"], facts, tmp_path, tmp_path / "page.md")
    assert "drifted by up to 6.0 % over the whole run" in (tmp_path / "page.md").read_text()
    alone = Facts.collect("trocar study modes", "abc", SMALLEST, {"modes": Cost(100.0, 120.0, 1.0)})
    assert not any("drifted" in line for line in alone.lines())


def test_the_page_needs_nothing_from_elsewhere_and_holds_every_point(written):
    page = (written / "index.html").read_text()
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", page)
    assert page.count("</script>") == 1  # what a setting is called cannot end the script
    data = json.loads(re.search(r"const data = (.*);\n", page)[1])
    assert len(data["rows"]) == 6
    assert data["studies"]["modes"]["title"]


def test_a_study_without_a_frontier_prints_what_it_says_of_itself(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(mesh, "findings", lambda rows: [f"{len(rows)} changes [of 1 effect]."])
    monkeypatch.setattr(modes, "findings", lambda rows: ["is in the table."])
    changes = [replace(row, study="mesh", is_known=False) for row in some_rows()]
    command._print([*some_rows(), *changes])
    told = capsys.readouterr().out
    assert "mesh: 6 changes [of 1 effect].\n" in told
    assert "on the frontier of" in told
    assert "is in the table" not in told
    command._print(changes)
    assert capsys.readouterr().out == "mesh: 6 changes [of 1 effect].\n"


def facts_of(code):
    return Facts.collect(f"trocar study at {code}", code, SMALLEST, {"modes": Cost(100.0, 120.0, 1.0)})


def report_of(rows, code, folder):
    """Write the page for the studies of these rows, by code of that name."""
    names = list(dict.fromkeys(row.study for row in rows))
    for name in names:
        (folder / f"{name}.svg").write_text(f"{name} of {code}")
    write_report(rows, names, facts_of(code), folder, folder / "page.md")
    return (folder / "page.md").read_text()


def rows_of(study, error):
    return [replace(row, study=study, error=error) for row in some_rows() if row.quantity == "force"]


def test_a_page_is_made_anew_in_parts(tmp_path, monkeypatch):
    for study in (modes, mesh):
        monkeypatch.setattr(study, "findings", lambda _: [])
    meshes = rows_of("mesh", 0.25)
    fine = replace(meshes[0], setting="fine", error=0.1, cost=Cost(300.0, 600.0, 1.0))
    report_of([*rows_of("modes", 0.125), *meshes, fine], "old", tmp_path)
    page = report_of(rows_of("modes", 0.5), "new", tmp_path)
    parts = dict(zip(("mesh", "modes", "slower"), page.split("\n## ")[1:], strict=True))
    assert "| 20 modes | **0.25** | 100±" in parts["mesh"]
    assert "code old" in parts["mesh"]
    assert "fixed arithmetic" not in parts["mesh"]  # that beside the other study is not told here
    assert "| 20 modes | **0.5** | 100±" in parts["modes"]
    assert "code new" in parts["modes"]
    assert "| mesh | force | fine | 0.1 % | 300 | 20 modes | 0.25 % | 200 |" in parts["slower"]
    assert (tmp_path / "page" / "modes.svg").read_text() == "modes of new"
    assert (tmp_path / "page" / "mesh.svg").read_text() == "mesh of old"


def test_a_series_that_is_only_drawn_has_a_line_and_no_table(tmp_path, monkeypatch):
    monkeypatch.setattr(modes, "findings", lambda _: [])
    rows = [replace(row, series="two effects" if row.setting == "60 modes" else "one") for row in some_rows()]
    monkeypatch.setattr(modes, "DRAWN_ONLY", {"two effects": "Every pair"}, raising=False)
    page = report_of(rows, "new", tmp_path)
    assert "| 20 modes |" in page
    assert "| 60 modes |" not in page
    assert "\nEvery pair (1): in the figure" in page


def test_settings_with_other_quantities_have_a_table_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(modes, "findings", lambda _: [])
    rows = [row for row in some_rows() if row.quantity == "force" or row.setting != "60 modes"]
    page = report_of(rows, "new", tmp_path)
    assert "| setting | force [%] | motion [%] | us ± noise |" in page
    assert "| setting | force [%] | us ± noise |\n| --- | --- | --- |\n| 60 modes |" in page


def test_the_page_in_the_documentation_is_what_its_studies_make_up():
    page = ROOT / "docs" / "results" / "accuracy.md"
    assert page.read_text(encoding="utf-8") == page_of(page.with_suffix(""))


def test_rows_beside_a_page_are_read_as_they_were_written(tmp_path):
    rows = [*some_rows(), replace(some_rows()[0], cost=None, is_known=False)]
    write_section(rows, facts_of("abc"), tmp_path / "modes.json")
    section = read_section(tmp_path / "modes.json")
    assert list(section.rows) == rows
    assert "code abc" in section.made_with[0]


def test_the_choice_for_a_slower_machine_is_the_least_wrong_that_fits_not_the_next_of_the_frontier():
    """A tick a little over the budget beats, within noise, one a little below; that is the best that fits."""

    def row(name, error, us):
        return Row("modes", name, "", "force", error, "%", cost=Cost(us, us, 10.0))

    rows = [row("coarse", 30.0, 100.0), row("middle", 2.0, 245.0), row("fine", 1.0, 255.0)]
    assert [each.setting for each in frontier(rows)] == ["coarse", "fine"]
    assert "| modes | force | fine | 1 % | 255 | middle | 2 % | 490 |" in slower_machine(rows)
    alike = [row("exact", 1e-9, 265.0), row("exact and cheap", 1e-7, 255.0), row("rough", 5.0, 100.0)]
    assert "| modes | force | exact and cheap | 1.0e-07 % | 255 | rough | 5 % | 200 |" in slower_machine(alike)


def test_a_choice_that_is_the_same_on_a_slower_machine_has_no_line():
    rows = [row for row in some_rows() if row.setting != "60 modes"]
    assert not any(line.startswith("| modes |") for line in slower_machine(rows))


@pytest.mark.parametrize("text", ["", "[]", '{"rows": []}', '{"made_with": [], "rows": [{"study": "modes"}]}'])
def test_what_is_no_study_beside_a_page_is_one_sentence(text, tmp_path):
    file = tmp_path / "modes.json"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"modes\.json is not a study beside a page: [^\n]+$"):
        read_section(file)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Return the elements of a page as a browser has them when its scripts have run."""
    if chromium.find() is None:
        pytest.skip("no browser here")
    with chromium.Chromium(tmp_path_factory.mktemp("browser") / "profile") as browser:

        def elements(page):
            browser.open(page.as_uri())
            browser.until(lambda: browser.evaluate("document.readyState") == "complete", 100, "the page is there")
            return browser.evaluate("document.documentElement.outerHTML")

        yield elements


def test_large_numbers_leave_room_for_what_the_axis_is_called(shown, tmp_path):
    """Millions of operations were written over it."""
    rows = [replace(row, error=1.2e7 * row.error + 1.0, is_known=False) for row in some_rows()]
    write_page(rows, {"modes": Text("modes", "")}, facts_of("abc"), tmp_path / "index.html")
    page = shown(tmp_path / "index.html")
    ticks = [each for each in re.findall(r'text-anchor="end">([^<]*)</text>', page) if "modes" not in each]
    assert "4e6" in ticks
    assert max(map(len, ticks)) <= len("0.0001")


@pytest.fixture
def acted(shown, tmp_path):
    """Return the elements of the page of some rows after a script."""

    def elements(rows, act):
        write_page(rows, {"modes": Text("modes", "")}, facts_of("abc"), tmp_path / "index.html")
        page = (tmp_path / "index.html").read_text()
        (tmp_path / "acted.html").write_text(page.replace("</html>", f"<script>{act}</script></html>"))
        return shown(tmp_path / "acted.html")

    return elements


def test_points_that_lie_on_one_another_can_be_chosen_by_mouse(acted):
    rows = [
        Row("modes", name, "", "force", 1.0, "%", cost=Cost(us, us, 1.0), choices={"n": name})
        for name, us in (("under", 100.0), ("over", 100.0), ("far", 300.0))
    ]
    click = "dispatchEvent(new MouseEvent('click'))"
    at_place = f"document.querySelectorAll('circle')[1].{click};"
    page = acted(rows, at_place)
    assert "2 points lie here: " in page
    assert re.findall(r'<button type="button" aria-pressed="(\w+)">(\w+)', page) == [
        ("false", "under"),
        ("true", "over"),
    ]
    assert "<th>n</th><td>over</td>" in page
    page = acted(rows, at_place + f"document.querySelector('#here button').{click};")
    assert "<th>n</th><td>under</td>" in page
    assert re.search(r'class="[^"]*chosen"><title>under', page.rpartition("<circle")[2]), "in front of what covered it"
    alone = acted(rows, f"document.querySelectorAll('circle')[2].{click};")
    assert re.search(r'<p id="here" hidden=""', alone)
    assert "<th>n</th><td>far</td>" in alone


def test_a_series_that_is_in_the_way_can_be_left_out_and_its_frontier_with_it(acted):
    rows = [
        Row("modes", name, series, "force", error, "%", cost=Cost(us, us, 1.0))
        for name, series, error, us in (("a", "one", 2.0, 100.0), ("b", "two", 1.0, 90.0), ("c", "one", 1.5, 200.0))
    ]
    leave_out = "document.querySelectorAll('#legend input')[1].click();"
    page = acted(rows, leave_out)
    assert page.count("<circle") == 2
    assert len(re.search(r'class="best" points="([^"]+)"', page)[1].split()) == 2
    assert acted(rows, leave_out + leave_out).count("<circle") == 3


def test_a_figure_of_a_studys_own_is_held_by_the_page(shown, acted, tmp_path):
    (tmp_path / "own.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="30" height="20"/>')
    texts = {"modes": Text("modes", "", figure=held_figure(tmp_path / "own.svg"))}
    write_page(some_rows(), texts, facts_of("abc"), tmp_path / "index.html")
    (tmp_path / "own.svg").unlink()
    act = "const own = by('figure'); own.onload = () => { document.title = `${own.hidden} ${own.naturalWidth}`; };"
    page = (tmp_path / "index.html").read_text().replace("quantities();\n</script>", f"{act} quantities();\n</script>")
    (tmp_path / "acted.html").write_text(page)
    assert "<title>false 30</title>" in shown(tmp_path / "acted.html")
    assert re.search(r'<img id="figure"[^>]* hidden=""', acted(some_rows(), ""))


def test_the_frontier_of_the_page_is_that_of_the_table(acted):
    draw = np.random.default_rng(3)
    powers = draw.uniform(-6.0, 1.0, 40)
    times_us = 150.0 - 15.0 * powers + draw.uniform(-10.0, 10.0, 40)
    rows = [
        Row("modes", f"{k}", "", "force", 10.0**power, "%", cost=Cost(us, us, noise))
        for k, (power, us, noise) in enumerate(zip(powers, times_us, draw.uniform(0.0, 6.0, 40), strict=True))
    ]
    tell = "document.title = frontier(ofStudy()).map(row => row.setting).join(' ')"
    told = re.search(r"<title>([\d ]+)</title>", acted(rows, tell))
    assert told[1].split() == [row.setting for row in frontier(rows)]
    assert len(told[1].split()) > 2


def test_a_point_can_be_chosen_in_a_browser(written, shown):
    page = (written / "index.html").read_text()
    act = "by('budget').value = 120; draw(); document.querySelector('circle').dispatchEvent(new MouseEvent('click'))"
    (written / "clicked.html").write_text(page.replace("</html>", f"<script>{act}</script></html>"))
    done = shown(written / "clicked.html")
    assert done.count("<circle") == 3
    assert re.search(r"<th>duct.n_modes</th><td>20</td>", done)
    assert "Least wrong within 120 us: 20 modes, 0.3333 % in 100 us." in done
    assert "<li>6 rows were read.</li>" in done
    assert done.count('class="name"') == 3
