# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Records kept on this machine: what comes back is what was put, within the budget, the oldest gone first."""

import hashlib
import os
import threading

from hypothesis import given, settings
from hypothesis import strategies as st
from maxcon.map.storage.disk_cache import DiskCache, default_cache

from maxcon.map.storage import RecordPlace


def place_of(content):
    return RecordPlace("tiles/0", 0, len(content), hashlib.sha256(content).digest())


def kept(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def test_what_was_put_comes_back(tmp_path):
    cache = DiskCache(tmp_path / "new" / "cache", 1000)
    assert cache.get(place_of(b"abc")) is None
    cache.put(place_of(b"abc"), memoryview(b"abc"))
    assert cache.has(place_of(b"abc")) and not cache.has(place_of(b"other"))
    assert bytes(DiskCache(tmp_path / "new" / "cache", 1000).get(place_of(b"abc"))) == b"abc"


def test_what_is_damaged_is_not_kept(tmp_path):
    cache = DiskCache(tmp_path, 1000)
    cache.put(place_of(b"abc"), memoryview(b"abX"))
    assert cache.get(place_of(b"abc")) is None
    assert not cache.has(place_of(b"abc"))


def test_what_was_used_longest_ago_goes_first(tmp_path):
    cache = DiskCache(tmp_path, 1000)
    contents = [bytes([number]) * 100 for number in range(11)]
    for number, content in enumerate(contents[:10]):
        cache.put(place_of(content), memoryview(content))
        os.utime(cache._path(place_of(content)), (number, number))
    assert cache.get(place_of(contents[0])) is not None  # used again
    cache.put(place_of(contents[10]), memoryview(contents[10]))
    # A tenth of the budget is free again, so that the folder is not looked through for every record.
    assert [cache.has(place_of(content)) for content in contents] == [True, False, False, *[True] * 8]


@given(st.lists(st.integers(1, 400), max_size=60), st.integers(0, 1500))
@settings(max_examples=25, deadline=None)
def test_the_budget_is_kept_but_for_what_came_last(tmp_path_factory, sizes, budget):
    folder = tmp_path_factory.mktemp("cache")
    cache = DiskCache(folder, budget)
    for number, size in enumerate(sizes):
        content = number.to_bytes(4, "little") * size
        cache.put(place_of(content), memoryview(content))
        assert kept(folder) <= budget


def test_several_threads_and_caches_share_a_folder(tmp_path):
    def work(seed):
        cache = DiskCache(tmp_path, 5000)
        for number in range(60):
            content = bytes([seed, number]) * 100
            cache.put(place_of(content), memoryview(content))
            got = cache.get(place_of(content))
            assert got is None or bytes(got) == content
        done.append(seed)

    done = []
    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(done) == [0, 1, 2, 3]


def test_a_record_that_another_process_removes_while_it_is_put_is_no_error(tmp_path, monkeypatch):
    replace = os.replace

    def replace_removed(source, target):
        source.unlink()
        replace(source, target)

    cache = DiskCache(tmp_path, 1000)
    with monkeypatch.context() as patched:
        patched.setattr("maxcon.map.storage.disk_cache.Path.replace", replace_removed)
        cache.put(place_of(b"abc"), memoryview(b"abc"))
    assert cache.get(place_of(b"abc")) is None
    assert not kept(tmp_path)
    cache.put(place_of(b"abc"), memoryview(b"abc"))
    assert bytes(cache.get(place_of(b"abc"))) == b"abc"


def test_where_and_how_many_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("MAXCON_CACHE_GB", "0.5")
    assert default_cache()._budget_bytes == 500_000_000
    monkeypatch.delenv("MAXCON_CACHE_GB")
    monkeypatch.delenv("MAXCON_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache = default_cache()
    assert (cache._budget_bytes, cache._folder) == (10_000_000_000, tmp_path / "maxcon" / "tiles")
