"""What a command cannot use, or needs and is not installed, is one line before the work, and nothing is written."""

import shutil

import numpy as np
import pytest

from maxcon.map.manifest import read_manifest

SIGMAS = ("--sigma-position", "1", "--sigma-heading-deg", "0.5")


# --- localize ---
@pytest.fixture
def not_localized(maxcon, refused, drive, out):
    """Check that localizing is refused with these words, and that nothing was written."""

    def check(*words, city=drive.city, scans=drive.dataset.scans, prior=drive.dataset.prior, options=()):
        outputs = ("-o", out / "poses.csv", "--tum", out / "poses.txt", "--plot", out / "pictures")
        refused(maxcon("localize", city, scans, "--prior", prior, *outputs, *options), *words)
        assert list(out.iterdir()) == []

    return check


@pytest.mark.parametrize(("change", "words"), [
    ((0, 1e9), ("a.txt and ", "386400.000", "same clock", "--times")),
    ((2, -1e6), ("a.txt and ", "city.map", "inside the map", "y 4801", "same CRS")),
    ((1, 1e300), ("inside the map",)),
])  # fmt: skip
def test_priors_of_no_use(not_localized, prior_rows, tmp_path, change, words):
    column, by = change
    for row in prior_rows:
        row[column] = str(float(row[column]) + by)
    (tmp_path / "a.txt").write_text("".join(" ".join(row) + "\n" for row in prior_rows))
    not_localized(*words, prior=tmp_path / "a.txt")


def test_scans_of_no_use(not_localized, drive, tmp_path):
    scans, times = tmp_path / "scans", tmp_path / "clock.txt"
    not_localized("times.txt", scans=drive.dataset.map_clouds[0].parent)  # a map is no folder of scans
    times.write_text("1\n")
    not_localized("4 times", times, "got 1", options=("--times", times))
    shutil.copytree(drive.dataset.scans, scans)
    for path in scans.glob("*.bin"):
        path.write_bytes(path.read_bytes()[: int(0.5001 * path.stat().st_size)])
    not_localized(scans / "000000.bin", "16 bytes per point", "truncated", scans=scans)  # not one can be read


def test_maps_of_no_use(not_localized, maxcon, refused, drive, tmp_path):
    not_localized("missing.map", "no manifest.json there", city=tmp_path / "missing.map")
    city = shutil.copytree(drive.city, tmp_path / "city.map")
    (shard,) = (city / "tiles").glob("*.arrows")
    content, table = bytearray(shard.read_bytes()), read_manifest(city).tiles
    for middle in (table.rows["offset"] + table.rows["length"] // 2).tolist():
        content[middle] ^= 1
    shard.write_bytes(content)
    not_localized(shard, "tile (", "checksum", "Build the map again", city=city)
    assert maxcon("map", "info", city).code == 0
    ended = maxcon("map", "info", city, "--check")
    assert ended.code == 2 and "checksum" in ended.err and "as they were written" not in ended.out
    (city / "manifest.json").write_text("{")
    refused(maxcon("map", "info", city), city / "manifest.json", "Build the map again")


@pytest.mark.parametrize(("options", "words"), [
    ("--sigma-position 1", ("--sigma-position together with --sigma-heading-deg",)),
    ("--sigmas 3", ("--sigmas together with --sigma-position or a CSV prior with covariances and no --track",)),
    ("SIGMAS --sigmas inf", ("--sigmas to be a finite number >= 0, got inf",)),
    ("SIGMAS --half-width 3", ("either --half-width or --sigma-position",)),
    ("--odometry o.txt", ("Expected --odometry together with --track or --deskew, got it alone.",)),
    ("--track --drift 0.01", ("Expected --drift together with --odometry, got it alone.",)),
    ("--track --resume", ("either --track or --resume",)),
    ("--track --workers 2", ("either --track or --workers or --scheduler",)),
    ("--resume --overwrite", ("either --resume or --overwrite",)),
    ("--mounting missing.toml", ("missing.toml",)),
    ("--geoid-height 40", ("not in latitude and longitude, or --geoid-height",)),
    ("--odometry-topic /a", ("--odometry-topic together with --odometry and a recording",)),
    ("--prior-frames a:b", ("is no recording, or --prior-frames",)),
    ("--objective nowhere_at_all:Name", ("ModuleNotFoundError",)),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_options_of_localize(not_localized, options, words):
    given = [word for part in options.split() for word in (SIGMAS if part == "SIGMAS" else (part,))]
    not_localized(*words, options=given)


def test_epochs_to_plot_without_a_folder(localize, refused, tmp_path):
    refused(localize("--plot-epochs", "0"), "--plot DIR")
    assert list(tmp_path.iterdir()) == []


# --- map build ---
@pytest.fixture
def not_built(maxcon, refused, out):
    """Check that building is refused with these words, and that nothing was written."""

    def check(*arguments, words):
        refused(maxcon("map", "build", *arguments, "-o", out / "city.map"), *words)
        assert list(out.iterdir()) == []

    return check


def test_clouds_of_no_use(not_built, write_las, street, street_npz, tmp_path):
    far, zero, drive = (tmp_path / name for name in ("far.npz", "zero.npz", "drive.txt"))
    np.savez(zero, points=street, times=np.zeros(len(street)))
    np.savez(far, points=np.concatenate([street, [[1e300, 0.0, 0.0]]]))
    drive.write_text("0 550000 5802000 62 0 0 0 1\n9 550001 5802000 62 0 0 0 1\n")
    not_built(tmp_path / ("a" * 300), words=["too long"])
    content = (broken := write_las("b.laz", crs=None)).read_bytes()
    broken.write_bytes(content[: len(content) // 2] + bytes(2000) + content[len(content) // 2 + 2000 :])
    not_built(street_npz, broken, words=["b.laz"])  # the first was whole
    not_built(far, words=[far, "farther away", "Remove it"])
    not_built(zero, "--trajectory", drive, words=["zero.npz", "gps_time is 0", "--trajectory"])


@pytest.mark.parametrize(("options", "words"), [
    ("--drop foo", ("'foo'", "ground", "vegetation", "--vehicle-class 64")),
    ("--vehicle-class 64 --keep-all", ("either --keep-all or --vehicle-class",)),
    ("--cell 6", ("in metres", "centimetres")),
    ("--threads 2 --scheduler tcp://127.0.0.1:1", ("either --threads or --scheduler",)),
], ids=lambda value: value[:30] if isinstance(value, str) else "")  # fmt: skip
def test_options_of_map_build(not_built, write_las, options, words):
    not_built(write_las(), *options.split(), words=words)


def test_what_is_there_is_kept_unless_it_is_to_be_replaced(maxcon, refused, street_npz, tmp_path):
    city, home, empty = (tmp_path / name for name in ("city.map", "home", "empty"))
    (home / "tiles").mkdir(parents=True), empty.mkdir()
    build = ("map", "build", street_npz, "-o")
    for path in (city, empty):
        assert maxcon(*build, path, "--overwrite").code == 0
    before = (city / "manifest.json").read_bytes()
    refused(maxcon(*build, city), city, "not to exist", "--overwrite")
    refused(maxcon("map", "build", tmp_path / "none.laz", "-o", city, "--overwrite"), "none.laz")
    assert (city / "manifest.json").read_bytes() == before
    ended = maxcon(*build, city, "--overwrite", "--sigma", "0.5")
    assert (ended.code, ended.err) == (0, "") and (city / "manifest.json").read_bytes() != before
    (home / "thesis.tex").touch(), (city / "notes.txt").touch()
    refused(maxcon(*build, home, "--overwrite"), home, "a map", "thesis.tex")
    refused(maxcon(*build, street_npz, "--overwrite"), street_npz, "Not a directory")
    refused(maxcon(*build, city, "--overwrite"), city, "notes.txt", "Move that away")
    assert (home / "thesis.tex").exists() and street_npz.exists() and (city / "notes.txt").exists()
    names = ["city.map", "empty", "home", "street.npz"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


@pytest.mark.parametrize(("package", "command", "extra"), [
    ("embreex", ("demo", "--out", "OUT"), "demo"),
    ("matplotlib", ("demo", "--out", "OUT"), "demo"),
    ("jinja2", ("demo", "--out", "OUT"), "demo"),
    ("embreex", ("simulate", "OUT"), "demo"),
    ("matplotlib", ("localize", "MAP", "SCANS", "--prior", "PRIOR", "-o", "OUT", "--plot", "PICTURES"), "demo"),
    ("rerun", ("localize", "MAP", "SCANS", "--prior", "PRIOR", "-o", "OUT", "--view"), "view"),
    ("rerun", ("relocalize", "MAP", "SCANS", "-o", "OUT", "--save", "OUT.rrd"), "view"),
    ("rerun", ("export", "POSES", "-o", "OUT.rrd", "--map", "MAP"), "view"),
    ("distributed", ("localize", "MAP", "SCANS", "-o", "OUT", "--scheduler", "tcp://127.0.0.1:8786"), "engine"),
    ("cyclonedds", ("live", "MAP", "--ros2"), "ros2"),
    ("pyogrio", ("export", "POSES", "-o", "OUT.gpkg", "--map", "MAP"), "export"),
])  # fmt: skip
def test_what_is_not_installed_is_said(
    maxcon, refused, without, drive, poses, out, monkeypatch, package, command, extra
):
    monkeypatch.setattr("maxcon.lab.demo.simulate", None)
    without(package)
    files = {"MAP": drive.city, "SCANS": drive.dataset.scans, "PRIOR": drive.dataset.prior, "POSES": poses}
    files |= {name: out / name for name in ("OUT", "OUT.gpkg", "OUT.rrd", "PICTURES")}
    ended = maxcon(*(files.get(word, word) for word in command))
    refused(ended, package, f"pip install 'maxcon[{extra}]'")
    assert list(out.iterdir()) == []


def test_localizing_needs_no_extra(localize, without):
    without(
        "matplotlib", "embreex", "jinja2", "trimesh", "pypcd4", "rosbags", "mcap", "distributed", "pyogrio", "rerun"
    )
    assert localize("--workers", "1").code == 0
