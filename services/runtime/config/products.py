"""Catheters and guide wires as sold: files that say what a scene leaves open of its catheter, or of the wire in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pydantic

from trocar.services.messages.sourced_value import SourcedValue
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError

FOLDER = "catheters"


_STRICT = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """A catheter or a guide wire.

    Attributes:
        title: For people.
        kind: Which part of a scene it is.
        values: By key of `CatheterScene`, or of `GuideWireScene`.
        sections: From the tip on, values by key of `CatheterSection`.
    """

    __pydantic_config__ = _STRICT

    title: str
    kind: Literal["catheter", "guide_wire"]
    values: dict[str, SourcedValue]
    sections: tuple[dict[str, SourcedValue], ...] = ()

    def named_values(self) -> dict[str, SourcedValue]:
        """Return all values by name, those of sections with their number."""
        named = dict(self.values)
        for k, section in enumerate(self.sections):
            named |= {f"sections.{k}.{key}": value for key, value in section.items()}
        return named


def product_names() -> list[str]:
    """Return the names of all products there are."""
    return sorted(path.stem for path in (config.config_directory() / FOLDER).glob("*.yaml"))


def load_product(name: str | Path) -> Product:
    """Return a product by its name in configs/catheters, or of a file.

    Raises ConfigError: one sentence that names the file and the key.
    """
    path = config.find("catheter", name)
    return config.build(Product, config.read_yaml(path), str(path))


def take_products(data: dict[str, Any], where: str, origins: config.Origins) -> None:
    """Write what ``catheter.product`` and ``catheter.guide_wire.product`` say, beside what file and overrides say.

    The keys themselves are taken out: the content may be saved anywhere, and is complete without the product's file.
    Raises ConfigError if there is no such product, or it is of the other kind.
    """
    catheter = data.get("catheter")
    if not isinstance(catheter, dict):
        return
    _take_part(catheter, "catheter", "catheter", where, origins)
    if isinstance(catheter.get("guide_wire"), dict):
        _take_part(catheter["guide_wire"], "guide_wire", "catheter.guide_wire", where, origins)


def _take_part(part: dict[str, Any], kind: str, path: str, where: str, origins: config.Origins) -> None:
    name = part.get("product")
    if not isinstance(name, str):
        return
    try:
        product = load_product(_beside(name, where))
    except ConfigError as error:
        raise ConfigError(f"{where}: {path}.product: {config.alone(str(error))}") from None
    if product.kind != kind:
        raise ConfigError(f"{where}: {path}.product: {name!r} is a {product.kind}, not a {kind}")
    said: dict[str, Any] = {key: value.value for key, value in product.values.items()}
    if product.sections:
        said["sections"] = [{key: value.value for key, value in section.items()} for section in product.sections]
    del part["product"]
    for key in said.keys() - part.keys():
        part[key] = said[key]
        origins[f"{path}.{key}"] = f"product {name}"


def _beside(name: str, where: str) -> str | Path:
    """Return the path of a file that a scene names, beside the scene; a bare name as it is."""
    return Path(where).parent / name if Path(name).suffix in (".yaml", ".yml") else name
