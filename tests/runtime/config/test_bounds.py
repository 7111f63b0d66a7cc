"""Every number in a rig or device file has a least and a most, with its unit and a reason."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import pytest
from pydantic import AfterValidator, BaseModel

from trocar.services.gateway.devices.device_files import ArmFile, GraspFile
from trocar.services.gateway.drivers.grasp_simulated import SimulatedGraspSettings
from trocar.services.gateway.drivers.phantom_simulated import ArmSettings
from trocar.services.gateway.hands.hand_arm import HandSettings
from trocar.services.gateway.hands.steering import JawSettings, SteeringSettings
from trocar.services.runtime.config.bounds import Bounds, Core
from trocar.services.runtime.config.rig import Rig, Settings

MODELS = (Rig, ArmFile, GraspFile, ArmSettings, SimulatedGraspSettings, HandSettings, SteeringSettings, JawSettings)


def numbers(hint: Any, where: str) -> Iterator[tuple[str, Bounds | None]]:
    """Yield the place of each number below a type, and its bounds."""
    if get_origin(hint) is Annotated:
        base, *rest = get_args(hint)
        if base not in (int, float):
            yield from numbers(base, where)
            return
        found = (each.func for each in rest if isinstance(each, AfterValidator))
        yield where, next((each for each in found if isinstance(each, Bounds)), None)
    elif hint in (int, float):
        yield where, None
    elif isinstance(hint, type) and issubclass(hint, BaseModel):
        for name, inner in get_type_hints(hint, include_extras=True).items():
            if name in hint.model_fields:
                yield from numbers(inner, f"{where}.{name}")
    elif get_origin(hint) is not Literal:
        for inner in get_args(hint):
            yield from numbers(inner, where)


def models(hint: Any) -> Iterator[type[BaseModel]]:
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
        for inner in get_type_hints(hint, include_extras=True).values():
            yield from models(inner)
    elif get_origin(hint) is not Literal:
        for inner in get_args(hint):
            yield from models(inner)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_number_has_a_least_and_a_most_with_a_reason(model: type[BaseModel]) -> None:
    found = list(numbers(model, model.__name__))
    assert found
    assert [where for where, bounds in found if bounds is None] == []
    for where, bounds in found:
        assert bounds is not None
        assert -math.inf < bounds.least < bounds.most < math.inf, where
        assert len(bounds.why.split()) > 2, where


class Inner(Settings):
    """Holds a number that has no bounds."""

    deep: tuple[float, ...] = ()


class Outer(Settings):
    """Holds others, of which one has bounds."""

    plain: int | None = None
    bounded: Core | None = None
    told: bool = False
    inner: Annotated[tuple[dict[str, Inner], ...], "a remark"] = ()


def test_the_walk_finds_a_number_without_bounds_wherever_it_lies() -> None:
    assert {where for where, bounds in numbers(Outer, "outer") if bounds is None} == {"outer.plain", "outer.inner.deep"}


@pytest.mark.parametrize(
    "model", dict.fromkeys(each for model in MODELS for each in models(model)), ids=lambda model: model.__name__
)
def test_defaults_are_within_their_bounds(model: type[BaseModel]) -> None:
    defaults = {name: field.default for name, field in model.model_fields.items() if not field.is_required()}
    for name, hint in get_type_hints(model, include_extras=True).items():
        values = defaults.get(name)
        for number in values if isinstance(values, tuple) else (values,):
            for _, bounds in numbers(hint, name) if type(number) in (int, float) else ():
                assert bounds is not None
                assert bounds(number) == number


@pytest.mark.parametrize(
    ("value", "said"),
    [(10**400, f"{10**400} s is more than 2 s: a test"), (-1e300, "-1e+300 s is less than 1 s: a test")],
    ids=["more", "less"],
)
def test_a_number_out_of_bounds_is_told_with_its_unit_however_large_it_is(value: float, said: str) -> None:
    bounds = Bounds(1, 2, "s", "a test")
    with pytest.raises(ValueError, match=rf"^{re.escape(said)}$"):
        bounds(value)
    assert [bounds(1), bounds(2)] == [1, 2]
