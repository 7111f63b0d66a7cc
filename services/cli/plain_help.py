"""Help in which a text is a text: ``[[rig]]`` is shown as it is written, not taken for markup of the terminal."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any, TypeVar

import typer
from rich.markup import escape
from typer.core import TyperCommand

_Verb = TypeVar("_Verb", bound=Callable[..., Any])


class PlainCommand(TyperCommand):
    """A verb whose help, and that of its options, may have brackets in it."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of a copy whose brackets are escaped; what others read of this one stays as it is."""
        shown = copy(self)
        shown.help = escape(self.help or "")
        shown.params = [_escaped(each) for each in self.params]
        TyperCommand.format_help(shown, ctx, formatter)


def _escaped(parameter: Any) -> Any:
    shown = copy(parameter)
    shown.help = escape(parameter.help) if getattr(parameter, "help", None) else None
    return shown


class PlainTyper(typer.Typer):
    """A set of verbs that are `PlainCommand`."""

    def command(self, name: str | None = None, **options: Any) -> Callable[[_Verb], _Verb]:
        """Add a verb, as `typer.Typer.command` does."""
        return super().command(name, **{"cls": PlainCommand, **options})
