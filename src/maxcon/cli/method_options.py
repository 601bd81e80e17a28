# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The objective, by the words of the command line."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxcon.search.objectives import Objective

__all__ = ["parse_objective"]


def parse_objective(word: str) -> "Objective":
    """Return the objective of a name, or an own one: "package.module:Name", a class or an object.

    Modules are looked for in the working folder, too.

    Raises
    ------
    OptionError
        If there is none of that name, the module cannot be imported, or it has no objective of that name.
    """
    import sys
    from importlib import import_module

    from maxcon.errors import OptionError
    from maxcon.search.objectives import as_objective

    module_name, colon, name = word.partition(":")
    if not colon:
        return as_objective(word)
    sys.path.insert(0, "")
    try:
        found = getattr(import_module(module_name), name)
        return as_objective(found() if isinstance(found, type) else found)
    except Exception as error:  # the user's own code may fail in any way
        raise OptionError(
            f"Expected --objective {word!r} to name an objective in a module that can be imported, got"
            f" {type(error).__name__}: {error}"
        ) from error
    finally:
        sys.path.remove("")
