"""What a scene calls for: as many instruments as it has tools, and handles for those that have one."""

from __future__ import annotations

import pytest

from trocar.services.runtime.config import config
from trocar.services.runtime.config.scene_requirements import scene_requirements


@pytest.mark.parametrize(
    ("tools", "handles"),
    [
        ("[{}, {}]", [True, True]),
        ("[{}, {kind: probe}]", [True, False]),
        ("[{kind: probe}, {kind: forceps}]", [False, True]),
        ("[{kind: probe}]", [False]),
        ("[]", []),
        ("[{kind: spoon}, 3]", [True, True]),  # refused by those that use it
    ],
)
@pytest.mark.parametrize("rig", ["stub", "hardware", "mouse"])
def test_a_tool_without_a_handle_gets_no_drive(rig: str, tools: str, handles: list[bool]) -> None:
    loaded = config.load_rig(rig)
    fitted = scene_requirements("pinch", (f"forceps={tools}",)).fitted(loaded)
    assert [row.grasp is not None for row in fitted.gateway.instruments] == handles
    assert [row.arm for row in fitted.gateway.instruments] == [row.arm for row in loaded.gateway.instruments][
        : len(handles)
    ]


def test_a_scene_that_says_nothing_of_tools_takes_the_rig_as_it_is(tmp_path) -> None:  # type: ignore[no-untyped-def]
    scene = tmp_path / "plain.yaml"
    scene.write_text("catheter: {}\n")
    rig = config.load_rig("stub")
    assert scene_requirements(str(scene)).fitted(rig) == rig
