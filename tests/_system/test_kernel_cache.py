"""Compiled code is kept by what it was made of, and found by a fresh process; other contents go when unused."""

import os
import subprocess
import sys

import pytest

from maxcon._system import kernel_cache
from maxcon._system.kernel_cache import checked_code_folder, content_of_kernels
from maxcon.errors import FileError

FILES = {
    "search/kernels.py": "from maxcon.limits import (\n    EDGE,\n)\nfrom maxcon.map import WORDS\n",
    "limits.py": "from maxcon.deeper import STEP\nfrom maxcon.pose import Pose\nEDGE = 2 * STEP\n",
    "deeper.py": "STEP = 1\n", "map/__init__.py": "from maxcon.map.layout import WORDS\n",
    "map/layout.py": "WORDS = 8\n", "pose.py": "", "cli.py": "",
}  # fmt: skip


@pytest.mark.parametrize("changed", FILES)
def test_a_changed_kernel_or_constant_renews_the_code_and_nothing_else_does(tmp_path, changed):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = content_of_kernels(tmp_path)
    assert content_of_kernels(tmp_path) == before
    (tmp_path / changed).write_text(FILES[changed] + "MORE = 1\n")
    assert (content_of_kernels(tmp_path) == before) == (changed in ("pose.py", "cli.py"))


KERNEL = """
import sys
from maxcon._system.kernel_cache import njit

@njit(nogil=True, cache=True)
def double(x):
    return 2 * x

assert double(21) == 42 and double(0.5) == 1.0
print(sum(double.stats.cache_hits.values()), sum(double.stats.cache_misses.values()))
"""


@pytest.mark.cold
def test_a_fresh_process_finds_the_code_and_what_nobody_uses_is_removed(tmp_path):
    script, cache = tmp_path / "kernel.py", tmp_path / "cache"
    script.write_text(KERNEL)
    for name in ("maxcon-old", "maxcon-used", "others"):
        (cache / name).mkdir(parents=True)
    os.utime(cache / "maxcon-old", (0, 0))
    os.utime(cache / "others", (0, 0))
    found = [
        subprocess.run([sys.executable, script], env={**os.environ, "NUMBA_CACHE_DIR": str(cache)}, capture_output=True)
        for _ in range(2)
    ]
    assert [each.stdout.decode() for each in found] == ["0 2\n", "2 0\n"], found
    kept = {path.name for path in cache.iterdir()}
    assert {"maxcon-used", "others"} < kept and "maxcon-old" not in kept and len(kept) == 3


def test_no_folder_at_all_is_refused_by_a_warm_up(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    (tmp_path / "file").touch()
    monkeypatch.setattr(kernel_cache, "code_folder", kernel_cache.code_folder.__wrapped__)
    assert kernel_cache.code_folder() is None
    with pytest.raises(FileError, match=r"into .*cache, which NUMBA_CACHE_DIR names"):
        checked_code_folder()


def test_every_kernel_is_kept_so():
    kernels = kernel_cache.PACKAGE.rglob("*kernels.py")
    assert [path for path in kernels if "from maxcon._system.kernel_cache import njit" not in path.read_text()] == []
