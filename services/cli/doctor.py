"""``trocar doctor``: what this host can give the rig, and what to do where it cannot."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.cli import host_checks, probes
from trocar.services.cli.delay_checks import delays
from trocar.services.cli.host_checks import CheckResult, Verdict
from trocar.services.cli.validation import RefusedError, validate
from trocar.services.gateway.drivers import check_host
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig

_MARKS = {Verdict.OK: "[green]ok[/]", Verdict.WARN: "[yellow]warn[/]", Verdict.FAIL: "[red]fail[/]"}


def run_doctor(rig_name: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Print every check; exit with 1 where the rig could not run at all."""
    rig = config.load_rig(rig_name, overrides)
    findings = [
        *_options(rig_name, overrides),
        *host_checks.software(),
        *host_checks.scheduling(),
        *host_checks.storage(rig),
        *host_checks.ports(rig),
        *probes.graphics(),
        *_devices(rig),
        *delays(rig),
    ]
    if as_json:
        print(json.dumps({"ok": not _failed(findings), "checks": [asdict(f) for f in findings]}, indent=1))
    else:
        _print(findings)
    if _failed(findings):
        sys.exit(ExitCode.FAILURE)


def _options(rig_name: str, overrides: tuple[str, ...]) -> Iterator[CheckResult]:
    """Find a rig or scene that no process could use; those that it can are not told."""
    try:
        validate(rig_name, None, overrides)
    except RefusedError as error:
        yield CheckResult("configuration", Verdict.FAIL, str(error), "correct the file or the option that is named")


def _devices(rig: Rig) -> Iterator[CheckResult]:
    named = [each for row in rig.gateway.instruments for each in (row.arm, row.grasp) if each is not None]
    for check in check_host(named, in_use=bool(lock_holders(rig.transport))):
        yield host_checks.finding(check.name, check.ok, check.found, check.advice, needed=check.needed)


def _failed(findings: list[CheckResult]) -> bool:
    return any(finding.verdict is Verdict.FAIL for finding in findings)


def _print(findings: list[CheckResult]) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("", "check", "found", "what to do"):
        table.add_column(title, overflow="fold")
    for finding in findings:
        table.add_row(_MARKS[finding.verdict], *map(escape, (finding.name, finding.found, finding.advice)))
    Console(highlight=False).print(table)
