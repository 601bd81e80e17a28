"""Files to read that are files: opening a FIFO waits for ever, and a device may have no end."""

import errno
import hashlib
import os
import stat
from io import BufferedReader
from pathlib import Path


def check_regular(path: str | os.PathLike[str], mode: int | None = None) -> None:
    """Refuse what is no file, before anything opens it; OSError, in words for an error of ours."""
    mode = Path(path).stat().st_mode if mode is None else mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"a {'FIFO' if stat.S_ISFIFO(mode) else 'device or socket'}, no file", str(path))


def open_regular(path: str | os.PathLike[str]) -> BufferedReader:
    """Open a file to read its bytes; OSError at once, as of `check_regular`, if it is none."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags)
    try:
        check_regular(path, os.fstat(descriptor).st_mode)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """Return the first bytes of a file, all of them if there are no more; errors as of `open_regular`."""
    with open_regular(path) as stream:
        return stream.read(min(most_bytes, os.fstat(stream.fileno()).st_size))


def sha256_of_file(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal digits; errors as of `open_regular`."""
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
