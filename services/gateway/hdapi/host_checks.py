"""Checks of OpenHaptics on this host: library, arm, permissions, set-up and communication; with advice."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from trocar.services.gateway.devices.host_check import HostCheck, text_of
from trocar.services.gateway.devices.vendor_library import run_apart
from trocar.services.gateway.hdapi.constants import Parameter
from trocar.services.gateway.hdapi.library import Library
from trocar.services.runtime.errors import DeviceError

#: Vendor and product of USB arms; sources disagree on one that has them the other way round. None: any product.
_USB = (("2988", None), ("0301", "2988"))
_FIREWIRE_VENDOR = "0x000b99"  # SensAble
_NODES = ("ttyACM*", "hidraw*", "fw*")
_RULES = "deploy/70-trocar-phantom.rules"

_INSTALL = "install the vendor's OpenHaptics 3.4 and TouchDriver (docs/how-to/hardware.md), then `sudo ldconfig`"
_MISSING = {
    "libncurses": "apt install libncurses5 libtinfo5 (newer systems: link libncurses.so.6 and libtinfo.so.6 as .so.5)",
    "libtinfo": "apt install libncurses5 libtinfo5 (newer systems: link libncurses.so.6 and libtinfo.so.6 as .so.5)",
    "PhantomIO": "the TouchDriver is missing: " + _INSTALL,
}


def check(names: Sequence[str | None], library: str, in_use: bool, root: Path = Path("/")) -> Iterator[HostCheck]:
    """Yield checks to make before the arms `names` are opened through `library`."""
    loaded = _loads(library)
    yield loaded
    devices = list(_devices(root))
    yield _presence(devices, len(names))
    if devices:
        yield _permissions(root, devices)
    yield _set_up(root, names)
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            yield _shared(name, names.count(name))
        elif loaded.ok and not in_use:
            yield _answers(library, name)


def _loads(library: str) -> HostCheck:
    code, said = _run("load", library)
    advice = next((advice for part, advice in _MISSING.items() if part in said), _INSTALL)
    return HostCheck("OpenHaptics", code == 0, said, advice, needed=True)


def _presence(devices: list[Path], wanted: int) -> HostCheck:
    shown = ", ".join(_describe(device) for device in devices) or "no Phantom or Touch on USB or FireWire"
    advice = "plug in and switch on; an arm on Ethernet is not seen here"
    return HostCheck("arms plugged in", len(devices) >= wanted, shown, advice)


def _permissions(root: Path, devices: list[Path]) -> HostCheck:
    nodes = sorted(root / "dev" / node.name for device in devices for node in _nodes(device))
    closed = [str(node) for node in nodes if not os.access(node, os.R_OK | os.W_OK)]
    shown = f"not yours to open: {', '.join(closed)}" if closed else ", ".join(map(str, nodes)) or "no device file"
    advice = (
        f"sudo cp {_RULES} /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger; without a seat "
        "at this host: sudo adduser $USER plugdev, and a new login: docs/how-to/deployment.md#udev"
    )
    return HostCheck("arms' permissions", bool(nodes) and not closed, shown, advice)


def _set_up(root: Path, names: Sequence[str | None]) -> HostCheck:
    folder = Path(os.environ.get("GTDD_HOME") or Path.home() / ".3dsystems") / "config"
    folder = root / folder.relative_to("/") if folder.is_absolute() else folder
    wanted = [name or "Default Device" for name in names]
    missing = [name for name in wanted if not (folder / f"{name}.config").is_file()]
    shown = f"{folder}: {'no ' + ', no '.join(missing) if missing else ', '.join(wanted)}"
    advice = "run the vendor's Touch_Setup as this user and name the arms so; set GTDD_HOME to where it keeps them"
    return HostCheck("arms' set-up", not missing, shown, advice)


def _shared(name: str | None, count: int) -> HostCheck:
    said = f"{count} instruments of the rig have this arm, and only one of them can open it"
    advice = "give each instrument the name of its own arm: `settings: {name: ...}`"
    return HostCheck(f"arm {name or 'Default Device'}", False, said, advice, needed=True)


def _answers(library: str, name: str | None) -> HostCheck:
    code, said = _run("open", library, *(() if name is None else (name,)))
    advice = "look at cable and power, run the vendor's Touch_Diagnostic, end whatever else uses the arm"
    return HostCheck(f"arm {name or 'Default Device'}", code == 0, said, advice)


def _devices(root: Path) -> Iterator[Path]:
    for device in sorted((root / "sys/bus/usb/devices").glob("*")):
        vendor, product = text_of(device / "idVendor"), text_of(device / "idProduct")
        if any(vendor == v and p in (None, product) for v, p in _USB):
            yield device
    for device in sorted((root / "sys/bus/firewire/devices").glob("fw*")):
        if text_of(device / "vendor") == _FIREWIRE_VENDOR:
            yield device


def _nodes(device: Path) -> Iterator[Path]:
    """Yield the files in /dev of `device` and of devices below it, as named in sysfs."""
    if device.match("fw*"):
        yield device
        return
    for pattern in _NODES:
        yield from device.resolve().rglob(pattern)


def _describe(device: Path) -> str:
    product = text_of(device / "product") or "FireWire"
    ids = f"{text_of(device / 'idVendor')}:{text_of(device / 'idProduct')}"
    return f"{product} ({ids if ids != ':' else text_of(device / 'vendor')})"


def _run(*arguments: str) -> tuple[int, str]:
    return run_apart(__name__, *arguments)


def main(what: str, path: str, name: str | None = None) -> int:
    """Load the library or open an arm, print the outcome, return an exit code."""
    try:
        library = Library(path, "here")
        said = f"{path} loads"
        if what == "open":
            handle = library.open_device(name, "here")
            said = f"{library.string(Parameter.MODEL_TYPE)}, serial number {library.string(Parameter.SERIAL_NUMBER)}"
            library.c.hdDisableDevice(handle)
    except DeviceError as error:
        print(str(error).removeprefix("here: ").partition("; `trocar")[0])  # noqa: T201
        return 1
    print(said)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
