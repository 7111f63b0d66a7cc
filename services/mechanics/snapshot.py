"""A snapshot of a simulation's state, restored in place within a tick; building another simulation takes a second.

The state is in arrays, in the memory of structs and in attributes of many objects. All of them are found by following
references from the simulation, so that no part can be forgotten. Objects that no step changes are left out: the scene,
the reduced duct, and arrays that are not writable.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from types import MemberDescriptorType
from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.compiled.memory import SavedArrays, SavedPages
from trocar.services.mechanics.compiled.struct import Struct

_OURS = "trocar.services.mechanics."
_HOLDERS = (list, dict, set, deque)
_LARGE = 1 << 16
"""Bytes from which an array is saved by pages: at rest most of them are empty."""


class Snapshot:
    """The present state of `root` and of everything that it refers to.

    Args:
        root: Objects of `trocar.services.mechanics`, or a tuple or list of them.
        constant: Objects that never change, with everything that they refer to.
    """

    def __init__(self, root: object, constant: tuple[object, ...] = ()) -> None:
        self._attributes: list[tuple[Any, dict[str, Any]]] = []
        self._holders: list[tuple[Any, Any]] = []
        self._live: list[AnyArray] = []
        seen: dict[int, object] = {}
        self._follow(constant, seen)
        for found in (self._attributes, self._holders, self._live):
            found.clear()
        self._follow(root, seen)
        large = [array for array in self._live if array.nbytes >= _LARGE and array.nbytes % 8 == 0]
        self._pages = [SavedPages(array) for array in large]
        of_pages = set(map(id, large))
        self._arrays = SavedArrays([array for array in self._live if id(array) not in of_pages])

    def restore(self) -> None:
        """Restore the state."""
        for each, attributes in self._attributes:
            for name, value in attributes.items():
                if getattr(each, name, None) is not value:
                    object.__setattr__(each, name, value)
        for holder, content in self._holders:
            holder.clear()
            (holder.extend if isinstance(holder, list | deque) else holder.update)(content)
        self._arrays.restore()
        for pages in self._pages:
            pages.restore()

    def _follow(self, root: object, seen: dict[int, object]) -> None:
        """Save the state of `root` and of everything that it refers to, except objects seen before."""
        todo = [root]
        while todo:
            each = todo.pop()
            if id(each) not in seen:
                seen[id(each)] = each
                todo.extend(self._save(each))

    def _save(self, each: Any) -> Iterator[object]:
        """Save the state of `each` itself, and yield the objects that it refers to."""
        if isinstance(each, np.ndarray):
            if isinstance(each.base, np.ndarray):
                yield each.base
            elif each.flags.writeable and each.nbytes and each.dtype != object:
                self._live.append(each if each.flags.c_contiguous else each.T)
        elif isinstance(each, Struct):
            state = vars(each)
            self._live.append(np.frombuffer(state["_words"], np.int64))
            yield from (value for name, value in state.items() if not name.startswith("_"))
        elif type(each) in _HOLDERS:
            self._holders.append((each, each.copy()))
            yield from each.values() if isinstance(each, dict) else each
        elif isinstance(each, tuple):
            yield from each
        elif type(each).__module__.startswith(_OURS) and not isinstance(each, type):
            attributes = dict(_attributes_of(each))
            self._attributes.append((each, attributes))
            yield from attributes.values()


def _attributes_of(each: object) -> Iterator[tuple[str, Any]]:
    """Yield an object's attributes, including those in slots."""
    yield from getattr(each, "__dict__", {}).items()
    for kind in type(each).__mro__:
        for name, value in vars(kind).items():
            if isinstance(value, MemberDescriptorType) and hasattr(each, name):
                yield name, getattr(each, name)
