# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""An S3 server on this machine, and a bucket on it, for tests."""

from contextlib import contextmanager

import pytest


@contextmanager
def s3_server_here():
    """Address of an S3 server; the test is skipped where a package for it is missing."""
    pytest.importorskip("obstore", reason="the extra `remote` is not installed")
    moto = pytest.importorskip("moto.server", reason="moto, an S3 server, is not installed")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@contextmanager
def bucket_on(server, monkeypatch):
    """Address of an empty bucket; credentials and server are in the environment."""
    import boto3

    for name, value in {
        "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": server,
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    client = boto3.client("s3", endpoint_url=server, region_name="us-east-1")
    client.create_bucket(Bucket="maps")
    yield "s3://maps"
    for entry in client.list_objects_v2(Bucket="maps").get("Contents", ()):
        client.delete_object(Bucket="maps", Key=entry["Key"])
    client.delete_bucket(Bucket="maps")
