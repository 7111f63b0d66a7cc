"""A driver registers nowhere: the contract suite finds it, passes the one of the recipe and fails broken ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

DRIVERS, BENCHES = Path("services/gateway/drivers"), Path("tests/gateway/benches")
SUITE = "tests/gateway/devices/test_driver_contract.py"

#: What is spoiled in a copy of the recipe's driver, and the test of the contract that must see it.
BROKEN = {
    "reads_nan": ("handle[HANDLE_ANGLE] = angle", "handle[HANDLE_ANGLE] = float('nan')", "what_is_read"),
    "reads_no_rate": ("handle[HANDLE_RATE] =", "_rate =", "what_is_read"),
    "reads_degrees": ("handle[HANDLE_ANGLE] = angle", "handle[HANDLE_ANGLE] = 57.3 * angle", "what_is_read"),
    "never_fades": ('self._torque.write_text("0\\n")', "pass", "gone_after_close"),
    "pushes_unasked": ("if self.ready:", "if self._is_open:", "force_is_off_until_enabled"),
    "pushes_millinewtons": ("{torque_nm:.6f}", "{1e-3 * torque_nm:.6f}", "as_written"),
    "never_ready": ("self.ready = self._is_open\n", "pass\n", "as_written"),
    "pushes_after_its_end": ("if self.ready:", "if True:", "harmless"),
    "waits": ("angle = float", "__import__('time').sleep(0.001); angle = float", "never_wait"),
    "takes_any_setting": (
        "driver.read_settings(SysfsSettings, settings, place).folder",
        "settings.settings['folder']",
        "unknown",
    ),
    "bears_nothing": ("place).max_torque_nm", "place).max_torque_nm * 0.0", "positive"),
}


@pytest.fixture
def followed(tree: TreeCopy) -> TreeCopy:
    tree.follow("Adding a device driver")
    return tree


def test_a_driver_is_found_by_its_file_and_the_contract_sees_what_is_wrong_with_one(followed: TreeCopy) -> None:
    """The recipe itself runs the contract over its driver; here over broken ones, all in one run."""
    good, bench = ((followed.root / folder / "sysfs_handle.py").read_text() for folder in (DRIVERS, BENCHES))
    for name, (before, after, _) in BROKEN.items():
        assert before in good, name
        (followed.root / DRIVERS / f"{name}.py").write_text(good.replace(before, after))
        (followed.root / BENCHES / f"{name}.py").write_text(bench.replace('"sysfs_handle"', f'"{name}"', 1))
    (followed.root / DRIVERS / "has_no_bench.py").write_text(good)
    failed = followed.failed_tests(SUITE, "-k", " or ".join(("sysfs_handle", "has_no_bench", *BROKEN)))
    assert any("what_is_read" in test for test in failed["has_no_bench"])
    assert failed.pop("sysfs_handle", set()) == set()
    for name, (_, _, seen_by) in BROKEN.items():
        assert any(seen_by in test for test in failed[name]), f"{name}: {failed[name]}"
