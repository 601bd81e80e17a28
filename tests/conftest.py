"""What all tests share: examples per property, real data, folders built once per run, an S3 server, and a cluster."""

import os
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import Phase, settings

# No time limit per example: loops are compiled at first use.
settings.register_profile("maxcon", deadline=None, max_examples=20)
settings.register_profile("full", deadline=None, max_examples=100)
# For a mutation test: the same examples for every mutant, and no time for making a failing one simple.
settings.register_profile(
    "mutation", deadline=None, derandomize=True, database=None, phases=(Phase.explicit, Phase.generate),
    report_multiple_bugs=False,
)  # fmt: skip
settings.load_profile("full" if os.environ.get("CI") else "maxcon")


@pytest.fixture(scope="session")
def real_data():
    """Find a part of the real data, in $MAXCON_DATA or ../shared/data beside the repository; skip where it is not."""
    root = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def find(part):
        if not (root / part).exists():
            pytest.skip(f"no real data at {root / part}; set MAXCON_DATA")
        return root / part

    return find


@pytest.fixture(scope="session")
def built_once(tmp_path_factory):
    """Build a folder once per run, not once per worker: `built_once(name, make)` calls `make(folder)` if it is new."""
    base = tmp_path_factory.getbasetemp()
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def build(name, make):
        folder, done = root / name, root / f"{name}.done"
        with FileLock(root / f"{name}.lock"):
            if not done.exists():
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return build


@pytest.fixture(scope="session")
def s3_server():
    """Address of an S3 server on this machine; the test is skipped where a package for it is missing."""
    pytest.importorskip("obstore", reason="the extra `remote` is not installed")
    moto = pytest.importorskip("moto.server", reason="moto, an S3 server, is not installed")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def bucket(s3_server, monkeypatch):
    """Address of an empty bucket; credentials and server are in the environment."""
    import boto3

    keys = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1"}
    for name, value in (keys | {"AWS_ENDPOINT_URL": s3_server}).items():
        monkeypatch.setenv(name, value)
    client = boto3.client("s3", endpoint_url=s3_server, region_name="us-east-1")
    client.create_bucket(Bucket="maps")
    yield "s3://maps"
    for entry in client.list_objects_v2(Bucket="maps").get("Contents", ()):
        client.delete_object(Bucket="maps", Key=entry["Key"])
    client.delete_bucket(Bucket="maps")


@pytest.fixture
def dask():
    """Start a cluster of so many workers; what is waited for is waited for shortly."""
    distributed = pytest.importorskip("distributed")
    clusters = []

    def start(n_workers):
        clusters.append(
            distributed.LocalCluster(
                n_workers=n_workers, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
                silence_logs=50, memory_limit=0,
            )
        )  # fmt: skip
        return clusters[-1]

    yield start
    for each in clusters:
        each.close()
