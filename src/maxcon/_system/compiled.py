# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled loops, seen from outside: what they are given, when one is compiled, and where its code is kept."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError

__all__ = ["check_code_folder", "code_folders", "failures_to_keep_told", "on_compilation", "read_only_view"]

NAME_A_FOLDER = "Name a folder that you can write in NUMBA_CACHE_DIR."


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


def code_folders() -> list[Path]:
    """Folders that keep the compiled code of all kernels loaded so far, sorted."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "maxcon"]
    kernels = {id(value): value for module in modules for value in vars(module).values()}
    paths = (kernel.stats.cache_path for kernel in kernels.values() if isinstance(kernel, Dispatcher))
    return sorted({Path(path) for path in paths if path is not None})


def check_code_folder() -> None:
    """Refuse to compile what cannot be kept, or not where NUMBA_CACHE_DIR says: it would silently be elsewhere.

    Raises
    ------
    FileError
        If the folder that NUMBA_CACHE_DIR names cannot be made or written; or there is no other.
    """
    from numba import njit

    folder = os.environ.get("NUMBA_CACHE_DIR")
    try:
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise FileError(
            f"Expected to be able to write compiled code into {folder}, which NUMBA_CACHE_DIR names, got:"
            f" {error.strerror or error}. {NAME_A_FOLDER}"
        ) from error
    with failures_to_keep_told():
        njit(cache=True)(check_code_folder)  # looks for a folder; nothing is compiled yet


@contextmanager
def failures_to_keep_told() -> Iterator[None]:
    """Say in one line that there is no folder to keep compiled code in.

    Raises
    ------
    FileError
        If neither the folder NUMBA_CACHE_DIR names, nor that of the program, nor that of the user can be written.
    """
    try:
        yield
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        raise FileError(
            "Expected a folder to keep compiled code in, but neither that of the program nor the user's own can"
            f" be written. {NAME_A_FOLDER}"
        ) from error
