"""What can go wrong that the user can mend: one base class, few kinds (D9).

Every message says what was expected, what came, and what to do about it.
"""

from collections.abc import Iterator
from contextlib import contextmanager


class MaxconError(Exception):
    """Base of everything maxcon raises on purpose."""


class ArrayError(MaxconError, ValueError):
    """An array or number has the wrong shape, type or values."""


class SearchSpaceError(MaxconError, ValueError):
    """A search space that cannot be built or does not fit the map or the memory."""


class FileError(MaxconError):
    """A file or folder is missing, empty, truncated, or not what its name says."""


class MapError(MaxconError):
    """A stored map is broken, of another format version, or does not fit its use."""


class TrajectoryError(MaxconError, ValueError):
    """Times or poses of a trajectory that cannot be used or do not cover what is asked."""


class CrsError(MaxconError, ValueError):
    """Coordinate reference systems that are unknown or do not agree."""


class OptionError(MaxconError, ValueError):
    """An option has a value that is not among those it can take."""


class MissingExtraError(MaxconError, ImportError):
    """A part of maxcon whose optional packages are not installed."""


@contextmanager
def needs_extra(package: str, purpose: str, extra: str) -> Iterator[None]:
    """Turn the ImportError of a package that is not installed into MissingExtraError; `purpose`: "to read a.e57"."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package {package} {purpose}, got none installed. pip install 'maxcon[{extra}]'"
        ) from error
