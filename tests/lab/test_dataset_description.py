"""What a dataset.toml may say, and what is said of one that is wrong."""

import time
import tracemalloc

import pytest

from maxcon.errors import FileError
from maxcon.lab.dataset import Dataset

PLAIN = """
[map]
clouds = "map/*.laz"
[scans]
folder = "scans"
reference = "reference.txt"
[priors]
gnss = "gnss.txt"
rough = "rough.txt"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "scans").mkdir()
    for name in ("map/b.laz", "map/a.laz", "reference.txt", "gnss.txt", "rough.txt"):
        (tmp_path / name).touch()
    (tmp_path / "map/mapping.txt").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    (tmp_path / "city.map").mkdir()
    return tmp_path


def opened(folder, text):
    (folder / "dataset.toml").write_text(text)
    return Dataset.open(folder)


def test_parts_are_named_relative_to_the_file(folder):
    dataset = opened(folder, PLAIN)
    assert [path.name for path in dataset.map_clouds] == ["a.laz", "b.laz"]
    assert dataset.scans == folder / "scans" and list(dataset.priors) == ["gnss", "rough"]
    assert dataset.prior == folder / "gnss.txt"
    assert (dataset.map_path, dataset.map_trajectory, dataset.crs, dataset.drop) == (None, None, None, None)
    (folder / "dataset.toml").rename(folder / "other.toml")
    assert Dataset.open(folder / "other.toml").map_clouds == dataset.map_clouds
    dataset = opened(folder, PLAIN.replace('clouds = "map/*.laz"', 'path = "city.map"'))
    assert (dataset.map_path, dataset.map_clouds) == (folder / "city.map", ())


def test_clouds_are_named_once_and_literally_with_any_dots(folder):
    (folder / "map/c[1].laz").touch()
    dataset = opened(folder, PLAIN.replace('"map/*.laz"', '["map/c[1].laz", "map/*.laz", "map/a.laz"]'))
    assert [path.name for path in dataset.map_clouds] == ["c[1].laz", "a.laz", "b.laz"]
    (folder / "map" / "a.1.2.3.laz").touch()
    clouds = '", "'.join(["map/a.1.2.3.laz"] * 50)
    dataset = opened(folder, PLAIN.replace('"map/*.laz"', f'["{clouds}"]') + "# " + "a." * 10 + "\n")
    assert [path.name for path in dataset.map_clouds] == ["a.1.2.3.laz"]


@pytest.mark.parametrize("name", ["ground", " Ground", "02"])
def test_the_ground_can_be_kept_however_it_is_named(folder, name):
    dataset = opened(folder, PLAIN.replace("[scans]", f'drop = ["{name}", "noise"]\n[scans]'))
    assert 2 in dataset.map_options().dropped_classes()
    assert dataset.map_options(keeps_ground=True).drop == ("noise",)


def test_what_it_says_of_the_map_becomes_its_options(folder):
    more = (
        'trajectory = "map/mapping.txt"\ncrs = "EPSG:25832"\ndrop = ["ground"]\nvehicle_classes = [64]\nsigma = 0.009\n'
    )
    options = opened(folder, PLAIN.replace("[scans]", more + "[scans]")).map_options(cell=0.1)
    assert (options.cell, options.crs, options.drop) == (0.1, "EPSG:25832", ("ground",))
    assert options.dropped_classes() >= {2, 64} and len(options.trajectory) == 2
    assert options.sigma == 0.009


@pytest.mark.parametrize(("old", "new", "words"), [
    ("[map]", "[map", "Expected a dataset's description in"),
    ('[priors]\ngnss = "gnss.txt"\nrough = "rough.txt"', "", "missing required field `priors`"),
    ("clouds", "cluods", "at `map`: object contains unknown field `cluods`"),
    ("map/*.laz", "map/*.las", "got none for 'map/\\*.las'"),
    ('"map/*.laz"', "[3]", r"at `map.clouds\[0\]`: expected `str`"),
    ('clouds = "map/*.laz"', "", "got neither"),
    ('"map/*.laz"', '"map/*.laz"\npath = "city.map"', "got both"),
    ("rough =", "reference =", "other than reference"),
    ('clouds = "map/*.laz"', 'path = "city.map"\ncrs = "EPSG:25832"', "beside the path of a built map"),
    ('"reference.txt"', '"nowhere.txt"', "to name what exists"),
    ('"map/*.laz"', '"map/*.laz"\nsigma = nan', "at `map.sigma`: expected `float` >= 0.0"),
    ('"map/*.laz"', '"map/*.laz"\nsigma = inf', "expected `float` <= 1000.0"),
])  # fmt: skip
def test_what_is_wrong_is_said(folder, old, new, words):
    assert old in PLAIN
    with pytest.raises(FileError, match=words):
        opened(folder, PLAIN.replace(old, new))


def test_what_is_no_dataset_is_refused(tmp_path):
    with pytest.raises(FileError, match=r"No such file.*Write a dataset\.toml"):
        Dataset.open(tmp_path)
    with pytest.raises(FileError, match="No such file"):
        Dataset.open(tmp_path / "nowhere")
    (tmp_path / "dataset.toml").write_bytes(b"#" * (2**20 + 1))
    with pytest.raises(FileError, match="more than 1,048,576 bytes"):
        Dataset.open(tmp_path)
    (tmp_path / "dataset.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match="Expected a dataset's description"):
        Dataset.open(tmp_path)


@pytest.mark.parametrize("key", ["folder", "clouds", "gnss"])
def test_names_longer_than_any_file_system_takes(folder, key):
    text = "\n".join(f'{key} = "{"a" * 300}"' if line.startswith(f"{key} =") else line for line in PLAIN.splitlines())
    with pytest.raises(FileError, match=rf"Expected {key} under .*a{{70}}"):
        opened(folder, text)


@pytest.mark.parametrize("text", [
    ".".join("a" * 20_000) + " = 1", "x = 1\n[" + ".".join(["'a'"] * 20_000) + "]",
    " . ".join(['"a b"'] * 10_000) + " = 1",
    "[map]\n" + "\n".join(".".join(["a"] * 100 + [str(number)]) + " = 1" for number in range(1000)),
    "a = " + "[" * 100_000, "a = " + "{a=" * 50_000, "a" * 1_000_000,
], ids=["dotted", "header", "quoted", "many", "lists", "tables", "word"])  # fmt: skip
def test_deep_keys_are_refused_in_little_memory(folder, text):
    tracemalloc.start()
    started = time.monotonic()
    with pytest.raises(FileError, match="got"):
        opened(folder, text)
    assert time.monotonic() - started < 100.0 and tracemalloc.get_traced_memory()[1] < 2**27
    tracemalloc.stop()
