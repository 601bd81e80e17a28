"""A small drive and its map, the command line in this process and in one of its own, and what an error is."""

import os
import signal
import subprocess
import sys
import time
import warnings
from typing import NamedTuple

import numpy as np
import pytest

import written_las
from maxcon.cli import main
from maxcon.cli.terminal import STOPPING
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.scanners import ProfileScanner
from maxcon.mapping.build import MapOptions, build_map

SCRIPT = "from maxcon.cli import main; main()"
# A shell's background jobs ignore interrupts, those of nohup hangups, and so do their children: the tests must
# not depend on it.
INTERRUPTIBLE = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
"""


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


class Drive(NamedTuple):
    """A simulated drive of four epochs, and the map of its city."""

    dataset: Dataset
    city: str
    reference: object

    @property
    def localize(self):
        """The arguments that localize it, up to the table."""
        return "localize", self.city, self.dataset.scans, "--prior", self.dataset.prior, "-o"

    @property
    def build(self):
        """The arguments that build its map, up to the folder."""
        return "map", "build", *self.dataset.map_clouds, "--trajectory", self.dataset.map_trajectory, "-o"


@pytest.fixture(scope="session")
def thin_profiles():
    """Profile scanners of few points, for maps that are built in seconds."""
    return tuple(ProfileScanner(turn_deg=turn, line_rate=80.0, points_per_line=720) for turn in (45.0, -45.0))


@pytest.fixture(scope="session")
def drive(built_once, thin_profiles):
    def make(at):
        dataset = simulate(at / "dataset", n_epochs=4, seed=3, before=30.0, after=20.0, mapping_scanners=thin_profiles)
        options = MapOptions(trajectory=read_trajectory(dataset.map_trajectory), vehicle_classes=(64,))
        build_map(dataset.map_clouds, at / "city.map", options)

    folder = built_once("drive", make)
    dataset = Dataset.open(folder / "dataset")
    return Drive(dataset, str(folder / "city.map"), read_trajectory(dataset.reference))


def call(*arguments):
    """Run the command line in this process; a Python warning is a failure: its lines would stand on stderr."""
    numbers = [getattr(signal, name) for name in STOPPING if hasattr(signal, name)]
    signals, argv = {number: signal.getsignal(number) for number in numbers}, sys.argv
    sys.argv = ["maxcon", *map(str, arguments)]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Of velodyne-decoder 3.1, on a newer numpy; Python shows it to nobody.
            warnings.filterwarnings("ignore", "Setting the (dtype|shape) on a NumPy array", DeprecationWarning)
            main()
    except SystemExit as ended:
        return ended.code or 0
    finally:
        sys.argv = argv
        for number, handler in signals.items():
            signal.signal(number, handler)
    return 0


@pytest.fixture(autouse=True)
def n_diagnosed(monkeypatch):
    """Of a drive that is not localized one epoch is tried otherwise, where three are else."""
    monkeypatch.setattr("maxcon.drive.diagnosis.MOST_TRIED", 1)


@pytest.fixture
def maxcon(capfd):
    """Run the command line in this process; say how it ended."""

    def run(*arguments):
        capfd.readouterr()
        code = call(*arguments)
        return Ended(code, *capfd.readouterr())

    return run


@pytest.fixture
def localize(maxcon, drive, tmp_path):
    """Localize the drive, or another prior, scans or map, into a file of the test's folder, with options."""

    def run(*options, prior=drive.dataset.prior, scans=drive.dataset.scans, city=drive.city, out="poses.csv"):
        by = () if prior is None else ("--prior", prior)
        return maxcon("localize", city, scans, *by, "-o", tmp_path / out, *options)

    return run


@pytest.fixture(scope="session")
def poses(drive, built_once):
    """POSES.csv of the drive, localized with the defaults once per run."""

    def make(folder):
        assert call(*drive.localize, folder / "poses.csv", "--tum", folder / "poses.txt", "-q") == 0

    return built_once("poses", make) / "poses.csv"


def rows_of_poses(path):
    """The rows of numbers of a trajectory, as text."""
    return [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]


@pytest.fixture
def prior_rows(drive):
    return rows_of_poses(drive.dataset.prior)


@pytest.fixture
def long_drive(drive, tmp_path):
    """The folder of the four scans of the drive, ten times over, with their prior and their reference."""
    folder = tmp_path / "long"
    folder.mkdir()
    times = [f"{number / 10.0:.6f}" for number in range(40)]
    for number in range(40):
        (folder / f"{number:06d}.bin").symlink_to(drive.dataset.scans / f"{number % 4:06d}.bin")
    (folder / "times.txt").write_text("\n".join(times) + "\n")
    for path in (drive.dataset.prior, drive.dataset.reference):
        poses = [" ".join([at, *row[1:]]) for at, row in zip(times, 10 * rows_of_poses(path), strict=True)]
        (tmp_path / f"long_{path.name}").write_text("\n".join(poses) + "\n")
    return folder, tmp_path / f"long_{drive.dataset.prior.name}", tmp_path / f"long_{drive.dataset.reference.name}"


@pytest.fixture(scope="session")
def maxcon_process():
    """Start the command line in a process of its own."""

    def start(*arguments, script=SCRIPT, **options):
        command = [sys.executable, "-c", INTERRUPTIBLE + script, *map(str, arguments)]
        environment = {**os.environ, "COLUMNS": "100", **options.pop("env", {})}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(command, env=environment, **{**pipes, **options})

    return start


@pytest.fixture(scope="session")
def maxcon_in_process_of_its_own(maxcon_process):
    """Run the command line in a process of its own, to its end."""

    def run(*arguments, **options):
        with maxcon_process(*arguments, **options) as process:
            out, err = process.communicate(timeout=900)  # it compiles, perhaps on a slow machine
        return Ended(process.returncode, out, err)

    return run


@pytest.fixture
def stopped_when(maxcon_process):
    """Start a command, send it a signal as soon as it has come so far, and return its exit code and stderr."""

    def run(number, has_come_so_far, *arguments, **options):
        with maxcon_process(*arguments, **options) as process:
            deadline = time.monotonic() + 600.0
            while not has_come_so_far(process) and process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.002)
            assert process.poll() is None, process.stderr.read()
            process.send_signal(number)
            _, err = process.communicate(timeout=600)
        return process.returncode, err

    return run


@pytest.fixture
def refused():
    """Check that a command ended as bad input does: exit code 2, and one line that says `words`."""

    def check(ended, *words):
        assert ended.code == 2, ended
        assert ended.out == ""
        assert ended.err.startswith("maxcon: "), ended.err
        assert ended.err.endswith(".\n") or ended.err.endswith("?\n") or "pip install" in ended.err, ended.err
        assert ended.err.count("\n") == 1, ended.err
        assert "Traceback" not in ended.err
        for word in words:
            assert str(word) in ended.err, f"{word!r} is not in: {ended.err}"

    return check


@pytest.fixture
def out(tmp_path):
    """An empty folder for what a command writes."""
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@pytest.fixture
def street():
    """Points of two walls, shape (n, 3), in global coordinates of UTM, m."""
    rng = np.random.default_rng(1)
    along, up = rng.uniform(0.0, 8.0, (2, 3000))
    points = np.column_stack([along, np.where(np.arange(3000) % 2, 0.03, 6.03), up])
    points[:500, :2] = points[:500, 1::-1]
    return points + [550_000.0, 5_802_000.0, 60.0]


@pytest.fixture
def street_npz(tmp_path, street):
    path = tmp_path / "street.npz"
    np.savez(path, points=street)
    return path


@pytest.fixture
def write_las(tmp_path, street):
    """Write the street as LAS or LAZ, with a CRS or none."""

    def write(name="street.laz", crs="EPSG:25832"):
        written_las.write_las(tmp_path / name, street, crs=crs, times=np.linspace(100.0, 110.0, len(street)))
        return tmp_path / name

    return write


@pytest.fixture
def without(monkeypatch):
    """Make packages impossible to import."""

    def hide(*names):
        for name in names:
            for loaded in [n for n in sys.modules if n == name or n.startswith(f"{name}.")]:
                monkeypatch.delitem(sys.modules, loaded)
            monkeypatch.setitem(sys.modules, name, None)

    return hide
