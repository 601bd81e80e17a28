"""A map on an object store or a web server is the same map; what is wrong there is said in a line, and in time."""

import pickle
import re
import socket
import threading
import time
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from maxcon import PointMap
from maxcon.errors import FileError, MapError, OptionError
from maxcon.map import storage
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Remote
from maxcon.map.store import copy_map
from written_maps import assert_same_map, said_by, write


class Ranges(SimpleHTTPRequestHandler):
    """Files of a folder, whole or a range of one; what was asked for is noted."""

    def do_GET(self):
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        self.server.asked.append((self.path, self.headers.get("Range")))
        if asked is None or not self.server.knows_ranges:
            super().do_GET()
            return
        try:
            content = Path(self.translate_path(self.path)).read_bytes()
        except OSError:
            self.send_error(404)
            return
        first, last = int(asked[1]), min(int(asked[2]), len(content) - 1)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{len(content)}")
        self.send_header("Content-Length", str(last - first + 1))
        self.end_headers()
        self.wfile.write(content[first : last + 1])

    def log_message(self, *_):
        pass


class Refusing(Ranges):
    """Gives nothing to anybody."""

    def do_GET(self):
        self.send_response(403)
        self.end_headers()

    do_HEAD = do_PUT = do_GET


@contextmanager
def serving(handler):
    """A web server on this machine, and its address."""
    pytest.importorskip("obstore", reason="the extra `remote` is not installed")
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.asked, server.knows_ranges = [], True
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server, f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


@pytest.fixture
def web_server(shards):
    """A web server of the folder that the map is in, and the map's address."""
    with serving(partial(Ranges, directory=str(shards.parent))) as (server, address):
        yield server, f"{address}/{shards.name}"


@pytest.fixture
def refusing():
    """Address of a server that gives nothing to anybody."""
    with serving(Refusing) as (_, address):
        yield address


def test_a_map_on_s3_is_the_map_that_was_copied_there(shards, bucket, tmp_path):
    there = f"{bucket}/germany/city"
    copy_map(shards, there)
    assert_same_map(PointMap.open(there), PointMap.open(shards))
    assert said_by(read_manifest(there)) == said_by(read_manifest(shards))
    for source, target in ((there, f"{bucket}/b"), (shards, "https://example.org/map")):
        with pytest.raises(OptionError, match="A web server is only read; between two object stores, copy to a folder"):
            copy_map(source, target)
    # One shard holds more than the small ones of the test: what is equal is what they hold.
    copy_map(there, tmp_path / "back.map")
    copy_map(tmp_path / "back.map", tmp_path / "again.map")
    assert_same_map(PointMap.open(tmp_path / "back.map"), PointMap.open(shards))
    files, again = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}
        for folder in (tmp_path / "back.map", tmp_path / "again.map")
    )
    assert files == again


def test_a_map_on_a_web_server_also_by_a_path_and_in_another_process(shards, web_server):
    server, web = web_server
    for opened in (PointMap.open(web), PointMap.open(Path(web))):  # a path of an address has lost a slash
        assert_same_map(opened, PointMap.open(shards))
    assert_same_map(pickle.loads(pickle.dumps(opened)), PointMap.open(shards))
    opened, key = PointMap.open(web), min(opened.tile_keys)
    server.asked.clear()
    opened.tile(key)
    name, first, length = read_manifest(shards).tiles.range_of(key)  # and not the whole shard
    assert server.asked == [(f"/{shards.name}/{name}", f"bytes={first}-{first + length - 1}")]
    server.knows_ranges = False
    refused(web, "to be the index of the map, got: the server sends no ranges")


def test_a_shard_that_is_damaged_there(bucket, shards):
    copy_map(shards, f"{bucket}/a")
    (file,) = read_manifest(shards).ground.files
    for content in (bytes(file.n_bytes), b"short"):
        Remote(f"{bucket}/a").write(file.name, content)
        with pytest.raises(MapError, match=rf"in {bucket}/a/{file.name} to be "):
            PointMap.open(f"{bucket}/a").ground_around(0.0, 0.0, 10.0)


# --- prefetching ---
def wait_until(is_so):
    end = time.monotonic() + 60.0
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)


def prefetching():
    return {thread for thread in threading.enumerate() if thread.name.startswith("prefetch")}


def test_tiles_are_fetched_several_at_a_time_by_threads_that_end_with_the_map(web_server):
    server, web = web_server
    others = prefetching()  # of maps that other tests keep
    opened = PointMap.open(web)
    opened.prefetch_around([(0.0, 0.0)], 100.0)
    assert len(prefetching() - others) > 1
    n_tiles = len(opened.tile_keys)
    wait_until(lambda: sum(".arrows" in path for path, _ in server.asked) >= n_tiles)
    n_asked = len(server.asked)
    opened.all_voxels()
    assert len(server.asked) == n_asked
    del opened
    wait_until(lambda: not prefetching() - others)


# --- what is not there ---
def refused(place, words):
    start = time.monotonic()
    with pytest.raises(MapError) as error:
        PointMap.open(place).all_voxels()
    assert words in str(error.value) and str(place) in str(error.value)
    assert "\n" not in str(error.value) and time.monotonic() - start < 300.0


def test_nothing_there(bucket, web_server, monkeypatch):
    server, web = web_server
    refused(f"{bucket}/nothing", "no manifest.json there")
    refused("s3://nobody-has-this", "no such bucket")
    refused(web + "x", "no manifest.json there")
    opened = PointMap.open(web)
    server.shutdown()
    server.server_close()
    refused(web, "connection refused")
    with pytest.raises(MapError, match="connection refused"):
        opened.all_voxels()
    monkeypatch.setenv("AWS_ENDPOINT_URL", web.rpartition("/")[0])
    refused(f"{bucket}/city", "connection refused")


def test_a_server_that_says_nothing(bucket, monkeypatch):
    monkeypatch.setattr(storage, "READ_SECONDS", 0.2)
    monkeypatch.setattr(storage, "RETRIES", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:  # it takes connections and never says a word
        silent = f"http://127.0.0.1:{server.getsockname()[1]}"
        refused(f"{silent}/city.map", "timed out")
        monkeypatch.setenv("AWS_ENDPOINT_URL", silent)
        refused(f"{bucket}/city", "timed out")


def test_no_permission_and_no_keys(shards, bucket, monkeypatch, refusing):
    """Without keys, those of a machine of Amazon are asked for, of an address that only such machines reach."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", refusing)
    refused(f"{bucket}/city", "no permission: check AWS_ACCESS_KEY_ID and its rights")
    with pytest.raises(FileError, match=r"to be able to write .* got: no permission"):
        copy_map(shards, f"{bucket}/city")
    monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    refused(f"{bucket}/city", "no permission without keys, as AWS_SKIP_SIGNATURE asks for: set AWS_ACCESS_KEY_ID and")
    with pytest.raises(MapError, match=r"got: no permission\. Check"):
        PointMap.open(f"{refusing}/city.map")
    monkeypatch.delenv("AWS_SKIP_SIGNATURE")
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
    words = storage._in_words(ValueError("something with AKIAOPEN and\nsecret-of-all"), is_s3=True)
    assert words == "something with AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"


# --- copying ---
def names(bucket, s3_server):
    import boto3

    listed = boto3.client("s3", endpoint_url=s3_server, region_name="us-east-1").list_objects_v2(Bucket="maps")
    return {entry["Key"] for entry in listed.get("Contents", ())}


def test_the_manifest_comes_last(shards, bucket, s3_server, monkeypatch):
    """Wherever copying stops there is no map, or the whole; and the same command goes on."""
    write_one, n_files = Remote.write, len([path for path in shards.rglob("*") if path.is_file()])
    for n_written in range(n_files):
        left = [n_written]

        def write_some(self, name, content, left=left):
            if left[0] == 0:
                raise OSError(5, "the line is cut")
            left[0] -= 1
            write_one(self, name, content)

        with monkeypatch.context() as patch:
            patch.setattr(Remote, "write", write_some)
            with pytest.raises(FileError, match="the line is cut"):
                copy_map(shards, f"{bucket}/{n_written}")
        assert len({name for name in names(bucket, s3_server) if name.startswith(f"{n_written}/")}) == n_written
        with pytest.raises(MapError, match=r"no manifest\.json there"):
            PointMap.open(f"{bucket}/{n_written}")
    copy_map(shards, f"{bucket}/{n_files - 1}")
    assert_same_map(PointMap.open(f"{bucket}/{n_files - 1}"), PointMap.open(shards))


def test_a_map_is_replaced_only_if_asked_and_who_reads_the_old_goes_on(shards, bucket, tmp_path):
    copy_map(shards, f"{bucket}/a")
    old = PointMap.open(f"{bucket}/a", cache_bytes=0)
    other = PointMap.from_points([[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], 0.06)
    write(tmp_path / "other.map", other)
    with pytest.raises(FileError, match=r"Expected no map at s3://maps/a yet, but there is one\..*--overwrite"):
        copy_map(tmp_path / "other.map", f"{bucket}/a")
    copy_map(tmp_path / "other.map", f"{bucket}/a", overwrite=True)
    assert PointMap.open(f"{bucket}/a").all_voxels()[1].sum() == 1
    assert_same_map(old, PointMap.open(shards))


def test_nothing_damaged_is_published(shards, bucket, tmp_path, s3_server):
    copy_map(shards, tmp_path / "copy.map")
    shard = sorted((tmp_path / "copy.map" / "tiles").glob("*.arrows"))[-1]
    shard.write_bytes(bytes(shard.stat().st_size))
    with pytest.raises(MapError, match="another checksum"):
        copy_map(tmp_path / "copy.map", f"{bucket}/a")
    assert names(bucket, s3_server) == set()
