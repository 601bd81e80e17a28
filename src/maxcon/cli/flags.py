"""Groups of options: dataclasses whose fields become flags, under the group's title in the help; what excludes what."""

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Annotated, Any, ClassVar, dataclass_transform, get_args

import typer
from typer.core import TyperCommand

from maxcon.errors import OptionError

TITLES = (  # in the order of the help; options without a title stand under the last
    "Arguments", "Inputs", "Scans instead of clouds", "Recordings and scanners", "Passes", "Classes", "Method",
    "Search space", "Motion", "Certainty", "Output", "How it is done", "Map", "Options",
)  # fmt: skip
HELP = re.compile(r"^(\w+): (.+(?:\n    .+)*)", re.MULTILINE)  # in the docstring of a group


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclass(frozen=True, kw_only=True)
class OptionGroup:
    """Base of groups: frozen dataclasses, whose fields are made by `flag` and `argument`, or are `Annotated`."""

    title: ClassVar[str]

    def __init_subclass__(cls, title: str = TITLES[-1]) -> None:
        cls.title = title
        dataclass(frozen=True, kw_only=True)(cls)


def flag(default: Any, help: str | None = None, *names: str, **how: Any) -> Any:
    """Return the field of an option: its default, or `...` where it must be given, and what typer is told of it.

    Long help stands in the docstring of its group, as `name: words`.
    """
    told = typer.Option(*names, help=help, **how)
    return field(default=MISSING if default is ... else default, metadata={"told": told})


def argument(default: Any, help: str | None, metavar: str, **how: Any) -> Any:
    """Return the field of an argument, likewise."""
    told = typer.Argument(help=help, metavar=metavar, **how)
    return field(default=MISSING if default is ... else default, metadata={"told": told})


def flags(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with a flag for each field of its parameters that are option groups."""
    parameters = inspect.signature(command).parameters
    groups = {
        name: each.annotation
        for name, each in parameters.items()
        if isinstance(each.annotation, type) and issubclass(each.annotation, OptionGroup)
    }
    flat: list[inspect.Parameter] = []
    for name, each in parameters.items():
        if name in groups:
            docs = [inspect.getdoc(each) or "" for each in groups[name].__mro__[::-1]]
            helps = dict(HELP.findall("\n".join(docs)))
            flat += [_parameter(field, groups[name].title, helps) for field in fields(groups[name])]
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


def _parameter(field: Field[Any], title: str, helps: Mapping[str, str]) -> inspect.Parameter:
    """The parameter of a field; a flag that is off if not given has no second name that turns it off."""
    kind, told = (field.type, field.metadata["told"]) if field.metadata else get_args(field.type)
    told = copy(told)
    told.rich_help_panel = told.rich_help_panel or title
    told.help = told.help or " ".join(helps.get(field.name, "").split())
    if field.default is False and told.default is ...:  # where typer keeps the first name that is given
        told.param_decls = (f"--{field.name.replace('_', '-')}",)
    default = inspect.Parameter.empty if field.default is MISSING else field.default
    option = Annotated[kind, told]  # type: ignore[valid-type]
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)


class GroupedCommand(TyperCommand):
    """A command whose help lists the options under the titles of their groups, as plain text."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in TITLES}
        for parameter in self.get_params(ctx):
            is_argument = parameter.param_type_name == "argument"
            title = TITLES[0] if is_argument else getattr(parameter, "rich_help_panel", None) or TITLES[-1]
            if record := parameter.get_help_record(ctx):
                sections[title].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def check_exclusive(*sides: Mapping[str, object]) -> None:
    """Refuse options, by their names, of more than one side: OptionError."""
    given = [name for side in sides for name in _given(side)[:1]]
    if len(given) > 1:
        raise OptionError(f"Expected either {given[0]} or {given[1]}, got both. Leave one out.")


def check_needs(options: Mapping[str, object], needed: Mapping[str, object]) -> None:
    """Refuse options where none of those is given that they act on: OptionError."""
    given = _given(options)
    if given and not _given(needed):
        raise OptionError(f"Expected {given[0]} together with {' or '.join(needed)}, got it alone. Give both or none.")


def _given(options: Mapping[str, object]) -> list[str]:
    return [name for name, value in options.items() if value is not None and value is not False and value != []]
