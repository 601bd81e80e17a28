# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Groups of options: dataclasses whose fields become flags, listed under the group's title in the help."""

import functools
import inspect
from collections.abc import Callable
from copy import copy
from dataclasses import MISSING, Field, field, fields, is_dataclass
from typing import Annotated, Any, ClassVar, get_args

import typer
from typer.core import TyperCommand

__all__ = ["TITLES", "GroupedCommand", "OptionGroup", "flag", "flags"]

TITLES = (
    "Arguments", "Inputs", "Recordings and scanners", "Rounds", "Classes", "Method", "Search space", "Motion",
    "Certainty", "Output", "How it is done", "Map", "Options",
)  # fmt: skip
"""Titles in the help, in this order; options without a title stand under the last."""


class OptionGroup:
    """Base of a frozen dataclass whose fields are made by `flag`, or annotated with a `typer.Option`."""

    title: ClassVar[str]


def flag(default: Any, help: str, *names: str, **how: Any) -> Any:
    """Return the field of an option group: a default, or `...` where it must be given, and what typer is told of it."""
    option = {"option": typer.Option(*names, help=help, **how)}
    return field(metadata=option) if default is ... else field(default=default, metadata=option)


def flags(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with a flag for each field of its parameters that are option groups."""
    parameters = inspect.signature(command).parameters
    groups = {name: each.annotation for name, each in parameters.items() if _is_group(each.annotation)}
    flat = []
    for name, each in parameters.items():
        if name in groups:
            flat += [
                inspect.Parameter(
                    field.name, inspect.Parameter.KEYWORD_ONLY, default=_default(field),
                    annotation=_titled(field, groups[name].title),
                )
                for field in fields(groups[name])
            ]  # fmt: skip
        else:
            flat.append(each.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @functools.wraps(command)
    def run(**values: Any) -> None:
        given = {
            name: group(**{field.name: values.pop(field.name) for field in fields(group)})
            for name, group in groups.items()
        }
        command(**values, **given)

    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in flat}
    return run


def _is_group(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, OptionGroup) and is_dataclass(annotation)


def _default(field: Field[Any]) -> Any:
    return inspect.Parameter.empty if field.default is MISSING else field.default


def _titled(field: Field[Any], title: str) -> Any:
    """The type of a field with its option, which stands under a title in the help."""
    kind, option = (field.type, field.metadata["option"]) if field.metadata else get_args(field.type)
    option = copy(option)
    option.rich_help_panel = title
    return Annotated[kind, option]


class GroupedCommand(TyperCommand):
    """A command whose help lists the options under the titles of their groups, as plain text."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in TITLES}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            is_argument = parameter.param_type_name == "argument"
            title = TITLES[0] if is_argument else getattr(parameter, "rich_help_panel", None) or TITLES[-1]
            if record is not None:
                sections[title].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
