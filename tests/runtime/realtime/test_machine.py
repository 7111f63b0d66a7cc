import platform
from pathlib import Path

from trocar.services.runtime.realtime.machine import processor_name


def test_the_processor_is_named_as_the_kernel_names_it(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nmodel name\t: Maker's Fast 7\n\nprocessor\t: 1\nmodel name\t: Maker's Fast 7\n")
    assert processor_name(cpuinfo) == "Maker's Fast 7"


def test_one_without_a_name_is_its_architecture(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nCPU implementer\t: 0x41\n")
    known = {platform.processor() or platform.machine()}
    assert {processor_name(cpuinfo), processor_name(tmp_path / "not there")} == known
