"""Settings in the rig file of a device of Force Dimension or Novint: of its arm, and of its gripper."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from trocar.services.gateway.dhd.library import DEFAULT
from trocar.services.runtime.config.bounds import between
from trocar.services.runtime.config.rig import Settings


class DhdSettings(Settings):
    """Which device, by which library; an arm and a gripper of one device have the same."""

    serial: Annotated[int, between(0, 65_535, "", "serial numbers are of 16 bits")] | None = Field(
        None, description="serial number of the device; none: the only one"
    )
    library: str = Field(DEFAULT, description="Force Dimension's DHD: a name that the loader finds, or a path")
    gravity_compensation: bool = Field(True, description="whether the device bears its own weight")
