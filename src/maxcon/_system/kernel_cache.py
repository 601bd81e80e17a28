"""Compiled code is kept by the content of all kernels and their constants, which numba does not look at."""

import hashlib
import inspect
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.misc.appdirs import AppDirs

from maxcon.errors import FileError

PACKAGE = Path(__file__).parents[1]
IMPORTS = re.compile(r"^from (maxcon[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)
CONSTANT = re.compile(r"\b[A-Z][A-Z0-9_]+\b")
PREFIX = "maxcon-"
UNUSED_SECONDS = 30 * 86400.0  # code of other contents is removed that was not used for so long


def njit(*, cache: bool = False, counts_references: bool = True, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return numba's `njit`, where a division by zero gives what it gives in numpy: loops are vectorized then.

    counts_references: of arrays, by an atomic instruction each: what neither makes nor returns arrays does without.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        chosen = options | {"error_model": "numpy"} | {"_nrt": counts_references}  # numba's types know no `_nrt`
        kernel: Any = numba.njit(**chosen)(function)
        if cache and isinstance(kernel, Dispatcher) and code_folder() is not None:
            kernel._cache = _ContentCache(function)  # type: ignore[attr-defined, no-untyped-call, unused-ignore]
        return kernel

    return decorate


@cache
def code_folder() -> Path | None:
    """Return the folder of the code of these kernels: in NUMBA_CACHE_DIR, or else the user's own, or the program's."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    users = AppDirs("maxcon", False)  # type: ignore[attr-defined, no-untyped-call, unused-ignore]
    roots = [named] if named else [users.user_cache_dir, PACKAGE / "__pycache__"]
    for root in map(Path, roots):
        folder = root / f"{PREFIX}{content_of_kernels(PACKAGE)[:20]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
        except OSError:
            continue
        _sweep(root)
        return folder
    return None


@contextmanager
def on_compilation(call: Callable[[], None]) -> Iterator[None]:
    """Call `call` whenever a function of maxcon is compiled anew, not where its code is loaded, while this is open."""

    class Listener(event.Listener):
        def on_start(self, event: event.Event) -> None:
            if event.data["dispatcher"].py_func.__module__.partition(".")[0] == "maxcon":
                call()

        def on_end(self, event: event.Event) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):  # type: ignore[no-untyped-call, unused-ignore]
        yield


def checked_code_folder() -> Path:
    """Return `code_folder`; FileError if what is compiled cannot be kept, or not where NUMBA_CACHE_DIR says."""
    folder, named = code_folder(), os.environ.get("NUMBA_CACHE_DIR")
    if folder is None:
        what = f"{named}, which NUMBA_CACHE_DIR names," if named else "the user's own cache or the program's folder"
        raise FileError(
            f"Expected to be able to write compiled code into {what} but cannot. Name a folder that you can write in"
            " NUMBA_CACHE_DIR."
        )
    return folder


def content_of_kernels(package: Path) -> str:
    """Return a digest of numba's version and the sources of all kernels and of the constants that they import."""
    files, waiting = set(), sorted(package.rglob("*kernels.py"))
    digest = hashlib.sha256(numba.__version__.encode())
    while waiting:
        file = waiting.pop()
        if file in files:
            continue
        files.add(file)
        for module, names in IMPORTS.findall(file.read_text(encoding="utf-8")):
            if file.name.endswith("kernels.py") or CONSTANT.search(names):
                place = package.joinpath(*module.split(".")[1:])
                waiting += sorted(place.glob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    for file in sorted(files):
        digest.update(str(file.relative_to(package)).encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _sweep(root: Path) -> None:
    """Remove the code of kernels that nobody has used for long."""
    for folder in root.glob(f"{PREFIX}*"):
        with suppress(OSError):  # another process is at it
            if time.time() - folder.stat().st_mtime > UNUSED_SECONDS:
                shutil.rmtree(folder)


class _Locator(_CacheLocator):
    """Where the code of a function is."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._py_file = file
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}"

    def get_cache_path(self) -> str:
        return str(code_folder())

    def get_source_stamp(self) -> str:
        return PREFIX  # the folder says which

    def get_disambiguator(self) -> str:
        return self._name

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        return cls(py_func, inspect.getfile(py_func))


class _Results(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - as numba has it


class _ContentCache(FunctionCache):
    """Numba's cache of a function, one process at a time writing to it: it counts files, and would take one for two."""

    _impl_class = _Results

    def save_overload(self, sig: Any, data: Any) -> None:
        from filelock import FileLock

        with FileLock(Path(self.cache_path) / ".lock"):
            super().save_overload(sig, data)  # type: ignore[attr-defined, no-untyped-call, unused-ignore]
