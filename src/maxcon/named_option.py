# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""NamedOption: an option whose values have names, given as such or as the plain word."""

from enum import StrEnum
from typing import ClassVar, Self

from maxcon.errors import OptionError

__all__ = ["NamedOption"]


class NamedOption(StrEnum):
    """Base of such options; a subclass says, as `option`, what its arguments are called, and lists its values."""

    option: ClassVar[str]

    def __init_subclass__(cls, *, option: str, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        cls.option = option

    @classmethod
    def parse(cls, value: str | Self) -> Self:
        """Return the value of that name.

        Raises
        ------
        OptionError
            If there is none.
        """
        try:
            return cls(value)
        except ValueError:
            *others, last = (repr(member.value) for member in cls)
            names = f"{', '.join(others)} or {last}"
            raise OptionError(f"Expected `{cls.option}` to be {names}, got {value!r}.") from None
