"""How a kernel preempts is told from what it says of itself, in whichever of four places it does."""

from __future__ import annotations

import pytest

from trocar.services.cli import host_checks, preemption
from trocar.services.cli.host_checks import Verdict
from trocar.services.cli.preemption import is_prompt, model

DYNAMIC = "#1 SMP PREEMPT_DYNAMIC Debian 6.12.9-1 (2025-01-10)"


@pytest.mark.parametrize(
    ("told", "how", "prompt"),
    [
        (("#1 SMP PREEMPT_RT Debian 6.12.9-1",), "rt", True),
        (("#1 SMP PREEMPT Debian 5.4",), "full", True),
        (("#1 SMP Debian 4.19",), "none", False),
        ((DYNAMIC,), "", True),
        (
            (DYNAMIC, "quiet", "CONFIG_PREEMPT_BUILD=y\nCONFIG_PREEMPT_VOLUNTARY=y\nCONFIG_PREEMPT_COUNT=y"),
            "voluntary",
            False,
        ),
        ((DYNAMIC, "quiet", "# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT=y\n"), "full", True),
        ((DYNAMIC, "quiet", "CONFIG_PREEMPT_NONE=y\n"), "none", False),
        ((DYNAMIC, "quiet", "CONFIG_PREEMPT_LAZY=y\n"), "lazy", True),
        ((DYNAMIC, "quiet preempt=full rw", "CONFIG_PREEMPT_NONE=y\n"), "full", True),
        ((DYNAMIC, "nopreempt=full", "CONFIG_PREEMPT_NONE=y\n"), "none", False),
        ((DYNAMIC, "preempt=full", "CONFIG_PREEMPT_NONE=y\n", "none (voluntary) full lazy\n"), "voluntary", False),
    ],
)
def test_how_a_kernel_preempts(told: tuple[str, ...], how: str, prompt: bool) -> None:
    assert model(*told) == how
    assert is_prompt(how) is prompt


def test_doctor_warns_of_a_kernel_that_ends_system_calls_first(monkeypatch: pytest.MonkeyPatch) -> None:
    for how, verdict in (("none", Verdict.WARN), ("full", Verdict.OK)):
        monkeypatch.setattr(preemption, "of_this_kernel", lambda how=how: how)
        (finding,) = (each for each in host_checks.scheduling() if each.name == "preemption")
        assert (finding.verdict, how in finding.found) == (verdict, True)
        assert ("preempt=full" in finding.advice) is (verdict is Verdict.WARN)
