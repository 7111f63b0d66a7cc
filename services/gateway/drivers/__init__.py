"""One file per driver, found by its name in the rig file; a new device only needs a file here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import cast

from trocar.services.gateway.devices.driver import Arm, GraspHandle, Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config.rig import DriverSettings
from trocar.services.runtime.errors import ConfigError, MissingPackageError


def known_drivers() -> list[str]:
    """Return the names of all driver files."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def load_arm(settings: DriverSettings, place: Place) -> Arm:
    """Return the arm named in the rig file, not yet open; raises as `load_grasp`."""
    return cast(Arm, _load(settings, "arm", place))


def load_grasp(settings: DriverSettings, place: Place) -> GraspHandle:
    """Return the handle named in the rig file, not yet open.

    Raises ConfigError: one sentence, if there is no such driver, it is of the other kind, or its settings or its device
    file are invalid. Raises MissingPackageError if it needs a package that is not installed.
    """
    return cast(GraspHandle, _load(settings, "handle", place))


def _load(settings: DriverSettings, kind: str, place: Place) -> object:
    where = f"instrument {place.instrument!r}"
    name = settings.driver
    module = _module(name, where)
    if not issubclass(module.Driver, Arm if kind == "arm" else GraspHandle):
        raise ConfigError(f"{where}, {kind}: driver {name!r} drives something else")
    return cast(object, module.Driver(settings, place))


def check_host(settings: Sequence[DriverSettings], in_use: bool) -> Iterator[HostCheck]:
    """Yield the host checks of the drivers of these devices; devices in use are not opened."""
    for name in dict.fromkeys(each.driver for each in settings):
        checks = getattr(_module(name, "rig"), "check_host", None)
        if checks is not None:
            yield from checks([each for each in settings if each.driver == name], in_use)


def _module(name: str, where: str) -> ModuleType:
    if name not in known_drivers():
        known = known_drivers()
        near = did_you_mean(name, known)
        raise ConfigError(f"{where}: there is no driver {name!r}; known: {', '.join(known)}{near}")
    try:
        return importlib.import_module(f"{__name__}.{name}")
    except ImportError as error:
        raise MissingPackageError(f"{where}: driver {name!r}", error.name) from None
