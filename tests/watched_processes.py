"""Whether processes live, as Linux tells."""

import time
from pathlib import Path


def is_alive(pid):
    """Whether a process lives; a zombie that nobody waits for counts as ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def all_ended(pids):
    """Whether all of some processes end within five minutes."""
    deadline = time.monotonic() + 300.0
    while any(map(is_alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(is_alive, pids))
