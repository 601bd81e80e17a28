# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Servers on this machine: an S3 server, and a web server that knows ranges; and a small map to put there."""

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from served_map import GROUND, VOXELS

from s3_buckets import bucket_on, s3_server_here
from written_maps import write


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    """Keep tiles in a folder of the test, and ask servers of this machine."""
    monkeypatch.setenv("MAXCON_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("MAXCON_CACHE_GB", raising=False)
    return tmp_path / "cache"


@pytest.fixture(scope="session")
def city(tmp_path_factory):
    """A map of 16 tiles in a folder, in several shards."""
    folder = tmp_path_factory.mktemp("maps") / "city.map"
    write(folder, VOXELS, GROUND, shard_bytes=30_000)
    return folder


@pytest.fixture(scope="session")
def s3_server():
    """Address of an S3 server."""
    with s3_server_here() as address:
        yield address


@pytest.fixture
def bucket(s3_server, monkeypatch):
    """Address of an empty bucket; credentials and server are in the environment."""
    with bucket_on(s3_server, monkeypatch) as address:
        yield address


class RangeHandler(SimpleHTTPRequestHandler):
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


@pytest.fixture
def web_server(city):
    """A web server of the folder that the map is in."""
    pytest.importorskip("obstore", reason="the extra `remote` is not installed")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(RangeHandler, directory=str(city.parent)))
    server.asked, server.knows_ranges = [], True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture
def web(web_server):
    """Address of the map on the web server."""
    return f"http://127.0.0.1:{web_server.server_address[1]}/city.map"
