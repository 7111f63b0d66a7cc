"""The pages of docs/reference that are made from the code: ``python -m tests.docs.reference`` writes them."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import typer
from pydantic import TypeAdapter

import trocar
import trocar.envs
from benchmarks import ideas
from trocar import front
from trocar.protocol.bodies import SupervisorState
from trocar.services.cli.app import add_installed_verbs, app
from trocar.services.cli.catheters import bending_stiffness_n_m2, source_of
from trocar.services.gateway.devices.device_files import DeviceFile
from trocar.services.mechanics.scene.cystic_duct import ALPHA_LENGTH, CAO, COURSES, RANGES
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.messages.first_sentence import first_sentence
from trocar.services.runtime.config.products import load_product, product_names
from trocar.services.runtime.config.rig import Rig
from trocar.services.scenes import scene_file_type
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.metrics import RigCollector, RigSource

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "reference"
_MADE = "Made by `python -m tests.docs.reference`; do not edit by hand."
_SHARED = (
    *("rig", "rig_name", "overrides", "json", "as_json", "scene", "help", "address", "token"),
    *("database", "rules", "experts"),
)
"""Options of many verbs, told once at the top of the page."""


def commands() -> str:
    """Return the page of the `trocar` command."""
    add_installed_verbs()
    lines = [
        "# The `trocar` command",
        "",
        _MADE,
        "",
        "`./dev VERB` sets up what is missing, then runs `trocar VERB`. `trocar --version` prints the version. The",
        "[exit code](exit-codes.md) of a verb says what kind of end it was.",
        "",
        "Most verbs take these options:",
        "",
        "- `--rig NAME`: a rig file, or the name of one in `configs/rigs` (default `stub`; or `TROCAR_RIG`).",
        "- `--scene NAME`: a scene file, or the name of one in `configs/scenes` (or `TROCAR_SCENE`).",
        "- `--set KEY=VALUE`: change one key; may be given again ([configuration](configuration.md)).",
        "- `--log-level LEVEL`, before the verb (or `TROCAR_LOG_LEVEL`): `debug`, `info`, `warning` or `error`; what",
        "  the verb and the processes that it starts tell on standard error. Results and refusals are always told.",
        "- `--json`: print one JSON object instead of text.",
        "- `--address URL`, `--token TOKEN` (`arm`, `safe-stop`): page of a rig elsewhere, and its printed token.",
        "- `--rules NAME`: rules of a score: a file, or the name of one in `configs/scores` (default `mistels`).",
        "- `--experts FILE`: reference attempts, as `trocar attempts export` writes them.",
        "- `--database`: file or address of the database of attempts; default: a file of this user.",
        "",
    ]
    for name, verb in sorted(_verbs(typer.main.get_command(app), "trocar")):
        lines += [f"## {name}", "", inspect.cleandoc(verb.help or "").replace("\n", " "), ""]
        told = [f"- {line}" for line in _options(verb)]
        lines += [*told, ""] if told else []
    return "\n".join(lines)


def _verbs(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    for word, inner in command.commands.items():
        if inner.hidden:
            continue
        yield from _verbs(inner, f"{name} {word}")


def _options(verb: Any) -> Iterator[str]:
    for option in verb.params:
        if option.name in _SHARED and not option.required:
            continue
        flags = (
            ", ".join(option.opts) if option.param_type_name == "option" else (option.metavar or option.name.upper())
        )
        default = option.default if not callable(option.default) else None
        said = f" (default {default})" if default not in (None, False, [], ()) else ""
        yield f"`{flags}`{said}: {option.help or ''}".rstrip(": ")


def metrics() -> str:
    """Return the page of the rig's metrics."""
    source = RigSource(SupervisorState(state=RigState.RUNNING))
    families = {
        level: {family.name: family for family in RigCollector(lambda: source, level).collect()}
        for level in ("summary", "full")
    }
    lines = {
        name: f"- `{name}{'_total' if family.type == 'counter' else ''}`: {family.documentation}"
        for name, family in families["full"].items()
    }
    return "\n".join(
        [
            "# Metrics",
            "",
            _MADE,
            "",
            "At `/metrics` of the page, at most 200 series. Loops only send counts, so a scrape never delays one.",
            "Counts begin at 0 again when a process restarts. Rules and dashboards: `deploy/monitoring`.",
            "",
            *(line for name, line in lines.items() if name in families["summary"]),
            "",
            "At `/metrics?level=full` also:",
            "",
            *(line for name, line in lines.items() if name not in families["summary"]),
            "",
        ]
    )


def configuration() -> str:
    """Return the page of rig, scene and device files: what the code allows, after what is said by hand."""
    lines = [_CONFIGURATION]
    kinds = {"Rig": Rig, "Scene": scene_file_type(), "Device": DeviceFile}
    for kind, model in kinds.items():
        schema = TypeAdapter(model).json_schema()
        lines += [f"## {kind} files", ""]
        if "properties" in schema:
            lines += _section("Top level", {**schema, "description": ""})
        for name, part in schema.get("$defs", {}).items():
            if part.get("properties") and name != "Effects":
                lines += _section(name.removesuffix("Settings").removesuffix("Scene"), part)
    return "\n".join(lines)


def _section(name: str, part: dict[str, Any]) -> list[str]:
    first = inspect.cleandoc(part.get("description") or "").split("\n\n")[0].replace("\n", " ")
    keys = part["properties"]
    lines = [f"**{name}**" + (f": {first}" if first else ""), ""]
    plain = [f"`{key}`{_default(about, ' ')}" for key, about in keys.items() if "description" not in about]
    lines += [", ".join(plain) + ".", ""] if plain else []
    told = [
        f"- `{key}`{_default(about, ' ')}: {about['description']}"
        for key, about in keys.items()
        if "description" in about
    ]
    return lines + ([*told, ""] if told else [])


def _default(about: dict[str, Any], before: str) -> str:
    value = about.get("default")
    if value is None or isinstance(value, dict) or (isinstance(value, list) and len(json.dumps(value)) > 40):
        return ""
    return f"{before}({json.dumps(value)})"


_CONFIGURATION = f"""# Configuration

{_MADE}

`trocar config schema rig`, `scene` or `device` prints the lists below as JSON schema.

- A **rig** (`configs/rigs`) says which processes run where, which devices they drive, and which deadlines they keep.
  `base` names another rig file that holds for whatever this one does not say.
- A **scene** (`configs/scenes`) says what is simulated. An effect that it does not name does not run.
- A **device** (`configs/devices`) says what an arm or a handle can bear.

Verbs take a file's path, or its name in the folder; `$TROCAR_CONFIG_DIR` is another folder. Units are in the names of
keys. An unknown key or a wrong type is refused, with the path of the key and the known ones.

`--set KEY=VALUE` changes one key, as YAML: `--set gateway.force_limit_n=2`. Keys of the scene work too:
`--set effects.friction.mu_kinetic=0.05`. A number in the path is a place in a list: `gateway.instruments.0.arm.driver`.
`trocar config show --origin` prints every value and the file, option or default that it comes from.

Below, the value in brackets is the default.
"""


def exit_codes() -> str:
    """Return the page of exit codes."""
    return "\n".join(
        [
            "# Exit codes",
            "",
            _MADE,
            "",
            "Every verb of `trocar` and every process of a rig ends with one of these. What went wrong stands in one",
            "sentence on standard error, results on standard output. `trocar up` ends with the code of the process",
            "that could not start, or was given up.",
            "",
            "| code | name | when |",
            "| --- | --- | --- |",
            *(f"| {code.value} | {code.name} | {code.meaning} |" for code in ExitCode),
            "",
        ]
    )


def names() -> str:
    """Return the page of public names."""
    lines = ["# Public names", "", _MADE, "", "[What stays, and for how long](../../CONTRIBUTING.md).", ""]
    for module, named_only in ((trocar, front.NAMED_ONLY), (trocar.envs, trocar.envs.NAMED_ONLY)):
        told = {name: first_sentence(inspect.getdoc(getattr(module, name)) or "") for name in module.__all__}
        lines += [f"## {module.__name__}", ""]
        lines += [*(f"- `{name}`: {what}" for name, what in told.items() if name not in named_only), ""]
        lines += ["Public because signatures of the others name them; they are asked of, not made:", ""]
        lines += [*(f"- `{name}`: {what}" for name, what in told.items() if name in named_only), ""]
    return "\n".join(lines)


def catheters() -> str:
    """Return the page of catheters and wires as sold."""
    lines = [
        "# Catheters and guide wires",
        "",
        _MADE,
        "",
        "A scene names one as `catheter.product`, and a wire in it as `catheter.guide_wire.product`: what the scene",
        "does not say itself is then taken from the product. Another one is a file of `configs/catheters`, or one",
        "beside the scene (`product: mine.yaml`). `trocar catheters` lists them. Values that are neither a norm nor",
        "measured are marked as assumptions. A wire is modelled as round and full: its modulus is the one that gives",
        "its measured bending stiffness; it stretches more than the real one.",
        "",
    ]
    for name in product_names():
        product = load_product(name)
        stiffness = f"{1e6 * bending_stiffness_n_m2(product):.3g} N mm²"
        lines += [f"## `{name}`", "", f"{product.title}; bending stiffness {stiffness}.", ""]
        lines += ["| value | is | from | to | source |", "| --- | --- | --- | --- | --- |"]
        for key, value in product.named_values().items():
            numbers = " | ".join(f"{number:g}" for number in (value.value, value.low, value.high))
            lines.append(f"| `{key}` | {numbers} | {source_of(value.source, value.assumed)} |")
        lines.append("")
    return "\n".join(lines)


def cystic_duct() -> str:
    """Return the page of the cystic duct by its anatomy."""
    lines = [
        "# The cystic duct",
        "",
        _MADE,
        "",
        "With `duct.cystic` a scene's duct is a cystic duct from its cut near the gallbladder, the mouth, to the",
        "common duct, whose ends `liver` and `duodenum` are held. What the scene does not say is drawn by `seed`,",
        "evenly within these ranges; without a seed it is the usual value. The same seed gives the same duct on every",
        "machine, and what is said changes nothing else that is drawn. `trocar cystic-duct --seed 7` shows what a",
        "seed draws.",
        "",
        "    trocar up --set duct.cystic='{seed: 7}' --set catheter.before_mouth_m=6e-3",
        "",
        "| key | usual | from | to | source |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, q in RANGES.items():
        lines.append(f"| `{name}` | {q.value:g} | {q.low:g} | {q.high:g} | {q.source} |")
    q = ALPHA_LENGTH
    lines.append(f"| `length_m` of an alpha | {q.value:g} | {q.low:g} | {q.high:g} | {q.source} |")
    shares = ", ".join(f"`{course}` {100 * share:g} %" for course, share in COURSES.items())
    lines += [
        "",
        f"`course`: {shares}. {CAO}:",
        "85 % run in a line, with variants S (passing round the common duct) and alpha (loops), 12 % come from the",
        "left, 3 % are angled down; the shares of the variants are assumptions.",
        "",
        "- Widths are those of the lumen and change evenly from `width_m` at the mouth to `end_width_m` at the",
        "  common duct; the surface that is meshed is half a wall (`duct.thickness_m`) outside.",
        "- `straight` runs along +x; `s` swings by `turn_rad` to either side; `alpha` turns once round and rises",
        "  meanwhile, so that its limbs pass each other.",
        "- `take_off_rad` is the angle between the cystic duct and the part of the common duct towards the liver.",
        "- `folds` are crescents in the half towards the gallbladder (pars spiralis, from 5 mm behind the mouth on);",
        "  the rest is smooth (pars glabra). Each is oblique, and they follow each other along a line that winds round",
        "  the lumen: crescents that look much like one spiral valve (Gray, Anatomy of the Human Body, 1918). 32 of 46",
        "  ducts of cadavers had folds, most of them uniform and oblique (Pina et al.). A crescent reaches two thirds",
        "  round, an assumption, is highest in its middle, and leaves the other side of the lumen open.",
        "  `fold_side_rad` is the side of the first. They are at least 2 mm apart: no more are drawn than have room.",
        "  `fold_height` is a fold's share of the lumen's radius there. A fold is solid: the mesh follows its inside,",
        "  which touches as the wall does, and its elements are thicker than the wall by as much as it is high. It is",
        "  1.25 walls wide at half its height. Only where there are folds the mesh is fine. [What they do to a",
        "  catheter](../results/cystic-folds.md).",
        "- `duct.traction_n` is the pull of a hand that holds the neck of the gallbladder, at the mouth: a pulled",
        "  duct is straighter and longer, its folds flatter. Without it the mouth is free, and so soft that folds",
        "  give way as a whole.",
        "- `duct.incision` cuts it partly, in its first 5 mm where it has folds, and the effect `clip` holds a",
        "  catheter in it: [the operation around the duct](../how-to/cholangiography.md).",
        "",
    ]
    return "\n".join(lines)


PAGES: dict[str, Callable[[], str]] = {
    "ideas.md": ideas.page,
    "catheters.md": catheters,
    "cystic-duct.md": cystic_duct,
    "exit-codes.md": exit_codes,
    "names.md": names,
    "cli.md": commands,
    "metrics.md": metrics,
    "configuration.md": configuration,
}


def main() -> None:
    """Write all pages."""
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
