# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled loops, seen from outside: what they are given, when one is compiled, and where its code is kept."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError


@contextmanager
def on_compilation(call: Callable[[], None]) -> Iterator[None]:
    """Call `call` whenever a function of maxcon is compiled anew, not where its code is loaded, while this is open."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: "event.Event") -> None:
            if event.data["dispatcher"].py_func.__module__.partition(".")[0] == "maxcon":
                call()

        def on_end(self, event: "event.Event") -> None:
            pass

    listener = Listener()
    event.register("numba:compile", listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)  # type: ignore[no-untyped-call]


def read_only_view(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array in one piece, as a view that cannot be written.

    Arrays of a tile that was read cannot be written, those in memory can: kernels would be compiled for either.
    """
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


def check_code_folder() -> None:
    """Refuse to compile what cannot be kept, or not where NUMBA_CACHE_DIR says; FileError if so."""
    from maxcon._system.kernel_cache import code_folder

    named = os.environ.get("NUMBA_CACHE_DIR")
    if code_folder() is None:
        what = f"{named}, which NUMBA_CACHE_DIR names," if named else "the user's own cache or the program's folder"
        raise FileError(
            f"Expected to be able to write compiled code into {what} but cannot. Name a folder that you can write in"
            " NUMBA_CACHE_DIR."
        )
