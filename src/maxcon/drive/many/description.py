# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Descriptions of methods in plain words and numbers, for the configuration that is saved with a study."""

import hashlib
import inspect
import os
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from maxcon.errors import OptionError

__all__ = ["describe"]


def describe(value: Any) -> Any:
    """Describe an object as JSON can hold it: the name of its class and the values of its public fields, recursively.

    Two methods of equal fields have the same description; it is not meant to be read back into one.

    Raises
    ------
    OptionError
        If something in it has no description: a function or a lock, say.
    """
    if isinstance(value, Enum):
        return describe(value.value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return describe(value.item())
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return {"class": "array", "type": str(value.dtype), "shape": list(value.shape), "sha256": digest}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, tuple | list):
        return [describe(item) for item in value]
    if isinstance(value, dict):
        return {str(key): describe(item) for key, item in value.items()}
    kind = type(value)
    own = {} if kind.__module__.startswith("maxcon.") else {"source": _source(kind)}
    return {"class": _name(kind), **own, **{key: describe(item) for key, item in _fields(value).items()}}


def _source(kind: type) -> str:
    """First 16 digits of the hash of the source of a user's class: it changes when the class is edited."""
    try:
        return hashlib.sha256(inspect.getsource(kind).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return "unknown"


def _name(kind: type) -> str:
    """Name of a class; with its module where it is not one of ours."""
    return kind.__qualname__ if kind.__module__.startswith("maxcon.") else f"{kind.__module__}.{kind.__qualname__}"


def _fields(value: Any) -> dict[str, Any]:
    """Public values of an object by their names."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.repr}
    if not hasattr(value, "__dict__") or isinstance(value, type) or callable(value):
        raise OptionError(
            f"Expected a method made of numbers, words and objects of such, got {value!r} in it, which cannot be"
            " written down. Make it a dataclass, or hide it behind an underscore."
        )
    return {key: item for key, item in sorted(vars(value).items()) if not key.startswith("_")}
