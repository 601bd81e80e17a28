# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map on an object store or a web server is the same map; what is wrong there is said in a line, and in time."""

import pickle
import socket
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from served_map import GROUND, VOXELS

from maxcon import PointMap
from maxcon.errors import FileError, MapError, OptionError
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import remote
from maxcon.map.writer import copy_map
from written_maps import write, write_tile_files


def assert_same(got, wanted):
    assert got.tile_keys == wanted.tile_keys
    for one, other in zip(got.all_voxels(), wanted.all_voxels(), strict=True):
        np.testing.assert_array_equal(one, other)
    heights = (each.ground_around(0.0, 0.0, 30.0).heights for each in (got, wanted))
    np.testing.assert_array_equal(*heights)


def test_a_map_on_s3_is_the_map_that_was_copied_there(city, bucket):
    copy_map(city, f"{bucket}/germany/city")
    assert_same(PointMap.open(f"{bucket}/germany/city"), PointMap.open(city))
    assert read_manifest(f"{bucket}/germany/city") == read_manifest(city)


def test_a_map_on_a_web_server(city, web):
    assert_same(PointMap.open(web), PointMap.open(city))


def test_a_path_of_an_address_has_lost_a_slash(city, web):
    assert_same(PointMap.open(Path(web)), PointMap.open(city))


def test_ranges_are_read_and_not_shards(city, web, web_server):
    opened = PointMap.open(web)
    key = sorted(opened.tile_keys)[3]
    web_server.asked.clear()
    opened.tile(key)
    table = read_manifest(city).tiles
    row = table.rows_by_key()[key]
    first = int(table.offsets[row])
    name = table.files[table.shards[row]].name
    assert web_server.asked == [(f"/city.map/{name}", f"bytes={first}-{first + int(table.lengths[row]) - 1}")]


def test_what_was_read_once_is_kept_on_this_machine(web, web_server, city, cache_folder):
    assert_same(PointMap.open(web), PointMap.open(city))
    n_records, end = (len(read_manifest(city).tiles) + len(read_manifest(city).ground), time.monotonic() + 300.0)
    while sum(path.is_file() for path in cache_folder.rglob("*")) < n_records:
        assert time.monotonic() < end
        time.sleep(0.01)
    web_server.asked.clear()
    assert_same(PointMap.open(web), PointMap.open(city))
    assert all("shard" not in path and ".arrows" not in path for path, _ in web_server.asked)


def test_a_damaged_file_of_the_cache_is_fetched_again(web, city, cache_folder):
    PointMap.open(web).all_voxels()
    for path in cache_folder.rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:-3] + b"abc")
    assert_same(PointMap.open(web), PointMap.open(city))


def test_without_a_cache_nothing_is_kept(web, city, cache_folder, monkeypatch):
    monkeypatch.setenv("MAXCON_CACHE_GB", "0")
    assert_same(PointMap.open(web), PointMap.open(city))
    assert not cache_folder.exists()


@pytest.mark.parametrize("text", ["much", "", "nan", "inf"])
def test_a_size_of_the_cache_that_is_none(web, monkeypatch, text):
    monkeypatch.setenv("MAXCON_CACHE_GB", text)
    with pytest.raises(OptionError, match="MAXCON_CACHE_GB to be a number of gigabytes"):
        PointMap.open(web)


def test_a_cache_that_cannot_be_written(web, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("MAXCON_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(FileError, match=r"keep tiles in .*, got: .*MAXCON_CACHE_GB=0"):
        PointMap.open(web).all_voxels()


def test_tiles_around_are_fetched_several_at_a_time(web, city, web_server):
    opened = PointMap.open(web)
    opened.announce(opened.tile_keys)
    end = time.monotonic() + 300.0
    while sum(".arrows" in path for path, _ in web_server.asked) < len(opened.tile_keys):
        assert time.monotonic() < end
        time.sleep(0.01)
    n_asked = len(web_server.asked)
    opened.all_voxels()
    assert len(web_server.asked) == n_asked


def test_an_opened_map_goes_to_another_process_as_its_address(web, city):
    again = pickle.loads(pickle.dumps(PointMap.open(web)))
    assert_same(again, PointMap.open(city))


def test_a_server_that_knows_no_ranges_is_refused_when_a_map_is_opened(web, web_server):
    web_server.knows_ranges = False
    with pytest.raises(
        MapError, match=rf"read {web}/manifest\.json, got: the server sends no ranges.*or copy"
    ) as refused:
        PointMap.open(web)
    assert "\n" not in str(refused.value)
    assert web_server.asked == [("/city.map/manifest.json", None), ("/city.map/manifest.json", "bytes=0-0")]


def test_a_shard_that_is_damaged_there(tmp_path, bucket, city):
    copy_map(city, f"{bucket}/a")
    store = remote.Remote(f"{bucket}/a", None)
    (name,) = {file.name for file in read_manifest(city).ground.files}
    store.write(name, bytes(read_manifest(city).ground.files[0].n_bytes))
    with pytest.raises(MapError, match=rf"in {bucket}/a/{name} to be as it was written, got another checksum"):
        PointMap.open(f"{bucket}/a").ground_around(0.0, 0.0, 10.0)
    store.write(name, b"short")
    with pytest.raises(MapError, match=rf"in {bucket}/a/{name} to be "):
        PointMap.open(f"{bucket}/a").ground_around(0.0, 0.0, 10.0)


# --- what is not there --------------------------------------------------------------------------------


def refused(place, words):
    start = time.monotonic()
    with pytest.raises(MapError) as error:
        PointMap.open(place).all_voxels()
    assert words in str(error.value)
    assert str(place) in str(error.value)
    assert "\n" not in str(error.value)
    assert time.monotonic() - start < 300.0


def test_nothing_there(bucket, web, s3_server):
    refused(f"{bucket}/nothing", "no manifest.json there")
    refused("s3://nobody-has-this", "no such bucket")
    refused(web + "x", "no manifest.json there")


def test_no_server(bucket, monkeypatch, web):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    refused(f"http://127.0.0.1:{port}/city.map", "connection refused")
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    refused(f"{bucket}/city", "connection refused")


@pytest.fixture
def silent():
    """Address of a server that takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"http://127.0.0.1:{server.getsockname()[1]}"


def test_a_server_that_says_nothing(silent, bucket, monkeypatch):
    monkeypatch.setattr(remote, "READ_SECONDS", 0.5)
    monkeypatch.setattr(remote, "RETRIES", 1)
    refused(f"{silent}/city.map", "timed out")
    monkeypatch.setenv("AWS_ENDPOINT_URL", silent)
    refused(f"{bucket}/city", "timed out")


def test_a_server_that_is_gone_after_opening(web, web_server):
    opened = PointMap.open(web)
    web_server.shutdown()
    web_server.server_close()
    with pytest.raises(MapError, match="connection refused"):
        opened.all_voxels()


class Refusing(BaseHTTPRequestHandler):
    """Gives nothing to anybody."""

    def do_GET(self):
        self.send_response(403)
        self.end_headers()

    do_HEAD = do_PUT = do_GET

    def log_message(self, *_):
        pass


@pytest.fixture
def refusing():
    """Address of a server that gives nothing to anybody."""
    with ThreadingHTTPServer(("127.0.0.1", 0), Refusing) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def test_no_permission(city, bucket, refusing, monkeypatch):
    monkeypatch.setenv("AWS_ENDPOINT_URL", refusing)
    refused(f"{bucket}/city", "no permission: check AWS_ACCESS_KEY_ID and its rights")
    with pytest.raises(FileError, match=r"to be able to write .* got: no permission"):
        copy_map(city, f"{bucket}/city")
    monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    refused(f"{bucket}/city", "no permission without keys, as AWS_SKIP_SIGNATURE asks for: set AWS_ACCESS_KEY_ID and")
    with pytest.raises(MapError, match=r"got: no permission\. Check"):
        PointMap.open(f"{refusing}/city.map")


def test_no_keys(bucket, refusing, monkeypatch):
    """Then those of a machine of Amazon are asked for, of an address that only such machines reach."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", refusing)
    monkeypatch.setenv("AWS_METADATA_ENDPOINT", refusing)  # so that nothing outside of this machine is asked
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    refused(f"{bucket}/city", "half of the keys: set both, AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    refused(
        f"{bucket}/city",
        "no keys were found: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (AWS_SESSION_TOKEN too, where they are"
        " temporary), or AWS_SKIP_SIGNATURE=true for a bucket that anybody may read",
    )


def test_no_message_has_the_keys(monkeypatch):
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAOPEN")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret-of-all")
    monkeypatch.delenv("AWS_SESSION_TOKEN", raising=False)
    words = remote._in_words(ValueError("something with AKIAOPEN and\nsecret-of-all"), is_s3=True)
    assert words == "something with AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"


# --- copying ------------------------------------------------------------------------------------------


def names(bucket, s3_server):
    import boto3

    listed = boto3.client("s3", endpoint_url=s3_server, region_name="us-east-1").list_objects_v2(Bucket="maps")
    return {entry["Key"] for entry in listed.get("Contents", ())}


def test_a_map_comes_back_as_the_same_bytes(city, bucket, tmp_path):
    copy_map(city, f"{bucket}/a")
    copy_map(f"{bucket}/a", tmp_path / "back.map")
    # one shard holds more than the small ones of the test: what is equal is what they hold
    assert_same(PointMap.open(tmp_path / "back.map"), PointMap.open(city))
    copy_map(tmp_path / "back.map", tmp_path / "again.map")
    files = {
        path.relative_to(tmp_path / "back.map"): path.read_bytes() for path in (tmp_path / "back.map").rglob("*.*")
    }
    again = {
        path.relative_to(tmp_path / "again.map"): path.read_bytes() for path in (tmp_path / "again.map").rglob("*.*")
    }
    assert files == again


def test_the_manifest_comes_last(city, bucket, s3_server, monkeypatch):
    """Wherever copying stops there is no map, or the whole; and the same command goes on."""
    write_one, n_files = remote.Remote.write, len([path for path in city.rglob("*") if path.is_file()])
    for n_written in range(n_files):
        left = [n_written]

        def write_some(self, name, content, left=left):
            if left[0] == 0:
                raise OSError(5, "the line is cut")
            left[0] -= 1
            write_one(self, name, content)

        with monkeypatch.context() as patch:
            patch.setattr(remote.Remote, "write", write_some)
            with pytest.raises(FileError, match="the line is cut"):
                copy_map(city, f"{bucket}/{n_written}")
        assert len({name for name in names(bucket, s3_server) if name.startswith(f"{n_written}/")}) == n_written
        with pytest.raises(MapError, match=r"no manifest\.json there"):
            PointMap.open(f"{bucket}/{n_written}")
    copy_map(city, f"{bucket}/{n_files - 1}")
    assert_same(PointMap.open(f"{bucket}/{n_files - 1}"), PointMap.open(city))


def test_a_map_is_replaced_only_if_asked_and_who_reads_the_old_goes_on(city, bucket, tmp_path):
    copy_map(city, f"{bucket}/a")
    old = PointMap.open(f"{bucket}/a", cache_bytes=0)
    other = PointMap.from_points([[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], 0.06)
    write(tmp_path / "other.map", other)
    with pytest.raises(FileError, match=r"Expected no map at s3://maps/a yet, but there is one\..*--overwrite"):
        copy_map(tmp_path / "other.map", f"{bucket}/a")
    copy_map(tmp_path / "other.map", f"{bucket}/a", overwrite=True)
    assert PointMap.open(f"{bucket}/a").all_voxels()[1].sum() == 1
    assert_same(old, PointMap.open(city))


def test_nothing_damaged_is_published(city, bucket, tmp_path, s3_server):
    copy_map(city, tmp_path / "copy.map")
    shard = sorted((tmp_path / "copy.map" / "tiles").glob("*.arrows"))[-1]
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    with pytest.raises(MapError, match="another checksum"):
        copy_map(tmp_path / "copy.map", f"{bucket}/a")
    assert names(bucket, s3_server) == set()


def test_an_old_map_becomes_a_new_one(tmp_path, bucket, city):
    write_tile_files(tmp_path / "old.map", VOXELS, GROUND)
    with pytest.raises(FileError, match="Copy it to a folder first"):
        copy_map(tmp_path / "old.map", f"{bucket}/a")
    assert copy_map(tmp_path / "old.map", tmp_path / "new.map").version == 3
    assert_same(PointMap.open(tmp_path / "new.map"), PointMap.open(city))


def test_from_an_address_to_another(city, bucket):
    copy_map(city, f"{bucket}/a")
    with pytest.raises(FileError, match="Copy it to a folder first"):
        copy_map(f"{bucket}/a", f"{bucket}/b")
