"""The file of a class: where its rigs are, who sits at each, and the one token of all who may look."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Settings
from trocar.services.runtime.errors import ConfigError


def _is_page(address: str) -> str:
    parts = urlsplit(address)
    is_server = parts.scheme in ("http", "https") and parts.hostname
    if not is_server or parts.path.strip("/") or parts.query or parts.fragment:
        raise ValueError(f"{address!r} is no page of a rig: http://ADDRESS:PORT or https://ADDRESS:PORT")
    return address.rstrip("/")


def _is_fingerprint(told: str) -> str:
    if told and not re.fullmatch(r"[0-9A-F]{2}(:[0-9A-F]{2}){31}", told.upper()):
        raise ValueError(f"{told!r} is no fingerprint: 32 pairs of digits 0 to F, with colons between")
    return told


class ClassRig(Settings):
    """A rig of the class; `trainee` is the pseudonym of who sits at it.

    A rig with an ``https`` address is known by the `fingerprint` of its certificate, which its terminal prints; without
    one, the authorities of this machine have to vouch for it.
    """

    name: Annotated[str, Field(min_length=1, max_length=64)]
    address: Annotated[str, AfterValidator(_is_page)]
    fingerprint: Annotated[str, AfterValidator(_is_fingerprint)] = ""
    trainee: Annotated[str, Field(max_length=64)] = ""


class Roll(Settings):
    """The whole file; `database` is where `trocar score` keeps attempts, for the last score of each trainee."""

    token: Annotated[str, Field(min_length=16)]
    database: str | None = None
    rig: Annotated[tuple[ClassRig, ...], Field(min_length=1, max_length=64)]

    @model_validator(mode="after")
    def _are_told_apart(self) -> Self:
        names = [place.name for place in self.rig]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"two rigs are called {twice!r}")
        return self


def load_roll(path: Path) -> Roll:
    """Return the class that a TOML file tells of.

    Raises ConfigError with the place in the file, if it cannot be used.
    """
    try:
        told = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: {error}") from None
    return config.build(Roll, told, str(path))
