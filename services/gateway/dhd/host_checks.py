"""Checks of Force Dimension's DHD on this host, for ``trocar doctor``: library, devices, permissions."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from trocar.services.gateway.devices.host_check import HostCheck, text_of
from trocar.services.gateway.devices.vendor_library import run_apart
from trocar.services.gateway.dhd.library import Library
from trocar.services.runtime.errors import DeviceError

#: Vendor and product on USB, None for any product: Force Dimension, and the Falcon behind its FTDI chip.
_USB = (("1451", None), ("0403", "cb48"))
_RULES = "deploy/71-trocar-force-dimension.rules"
_INSTALL = "install Force Dimension's SDK 3.17 (docs/how-to/hardware.md), then `sudo ldconfig`"


def check(library: str, serials: Sequence[int | None], in_use: bool, root: Path = Path("/")) -> Iterator[HostCheck]:
    """Yield checks to make before arms are opened through `library`."""
    loaded = _run("load", library)
    yield HostCheck("Force Dimension's DHD", loaded[0] == 0, loaded[1], _INSTALL, needed=True)
    devices = list(_devices(root))
    shown = ", ".join(text_of(device / "product") or device.name for device in devices)
    wanted = len(set(serials))
    found = shown or "no arm of Force Dimension or Novint on USB"
    yield HostCheck("arms plugged in", len(devices) >= wanted, found, "plug in and switch on")
    if devices:
        yield _permissions(root, devices)
    if loaded[0] == 0 and not in_use:
        code, said = _run("list", library)
        yield HostCheck("arms answer", code == 0, said, "look at cable and power, end whatever else uses the arm")


def _permissions(root: Path, devices: list[Path]) -> HostCheck:
    nodes = [_node(root, device) for device in devices]
    closed = [str(node) for node in nodes if not os.access(node, os.R_OK | os.W_OK)]
    shown = f"not yours to open: {', '.join(closed)}" if closed else ", ".join(map(str, nodes))
    advice = (
        f"sudo cp {_RULES} /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger; without a seat "
        "at this host: sudo adduser $USER plugdev, and a new login: docs/how-to/deployment.md#udev"
    )
    return HostCheck("arms' permissions", not closed, shown, advice)


def _node(root: Path, device: Path) -> Path:
    bus, number = (int(text_of(device / name) or 0) for name in ("busnum", "devnum"))
    return root / "dev/bus/usb" / f"{bus:03d}" / f"{number:03d}"


def _devices(root: Path) -> Iterator[Path]:
    for device in sorted((root / "sys/bus/usb/devices").glob("*")):
        vendor, product = text_of(device / "idVendor"), text_of(device / "idProduct")
        if any(vendor == v and p in (None, product) for v, p in _USB):
            yield device


def _run(*arguments: str) -> tuple[int, str]:
    return run_apart(__name__, *arguments)


def main(what: str, path: str) -> int:
    """Load the library or list its devices, print the outcome, return an exit code."""
    try:
        library = Library(path, "here")
        said = f"{path} loads"
        if what == "list":
            handles = [library.c.dhdOpenID(k) for k in range(max(0, library.c.dhdGetDeviceCount()))]
            opened = [handle for handle in handles if handle >= 0]
            said = ", ".join(f"{library.name(handle)}, serial {library.serial_number(handle)}" for handle in opened)
            for handle in opened:
                library.c.dhdClose(handle)
            if not said:
                raise DeviceError(f"here: no device can be opened: {library.error()}")
    except DeviceError as error:
        print(str(error).removeprefix("here: ").partition("; `trocar")[0])  # noqa: T201
        return 1
    print(said)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
