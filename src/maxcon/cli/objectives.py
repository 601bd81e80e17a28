# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Objectives by name: ours, or one of the user's own module."""

import sys
from importlib import import_module

from maxcon.errors import OptionError
from maxcon.search.objectives import Objective, as_objective


def parse_objective(word: str) -> Objective:
    """Return the objective of a name, or one's own, "package.module:Name": a class or an object.

    Modules are looked for in the working folder, too. OptionError if there is none.
    """
    module_name, colon, name = word.partition(":")
    if not colon:
        return as_objective(word)
    sys.path.insert(0, "")
    try:
        found = getattr(import_module(module_name), name)
        return as_objective(found() if isinstance(found, type) else found)
    except OptionError:
        raise
    except Exception as error:  # the user's own code may fail in any way
        raise OptionError(
            f"Expected {word!r} to name an objective in a module that can be imported, got"
            f" {type(error).__name__}: {error}. Write it as package.module:Name."
        ) from error
    finally:
        sys.path.remove("")
        if "" not in sys.path:
            sys.path.append("")  # where workers look for it, too
