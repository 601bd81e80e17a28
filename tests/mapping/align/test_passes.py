# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from maxcon.errors import FileError, OptionError
from maxcon.mapping.align.passes import read_passes, survey
from maxcon.mapping.build.sources import open_headers

TIMES = np.array([7.2, 8.9, 9.1, 100.4, 101.2, 160.0])
POINTS = np.arange(18.0).reshape(6, 3)


def silent(step, done, total):
    pass


def numbers(passes, headers):
    return np.concatenate(
        [
            passes.of_points(part.times, part.source_ids, file)
            for file, header in enumerate(headers)
            for part in read_passes(header)
        ]
    ).tolist()


@pytest.fixture
def headers(tmp_path, write_las):
    one = write_las(tmp_path / "b.las", POINTS[3:], TIMES[3:], source_ids=[7, 7, 3])
    other = write_las(tmp_path / "a.las", POINTS[:3], TIMES[:3], source_ids=[3, 3, 7])
    return open_headers([one, other])


def test_pauses_tell_passes_apart_in_order_of_time(headers):
    passes = survey(headers, "time", 20.0, silent)
    assert [each.name for each in passes] == ["pass 1", "pass 2", "pass 3"]
    assert [(each.start, each.end) for each in passes.passes] == [(7.0, 10.0), (100.0, 102.0), (160.0, 161.0)]
    assert numbers(passes, headers) == [1, 1, 2, 0, 0, 0]
    assert passes.are_apart
    assert passes.at(np.array([0.0, 50.0, 60.0, 140.0, 1e6])).tolist() == [0, 0, 1, 2, 2]
    assert len(survey(headers, "time", 70.0, silent)) == 2
    first = passes.passes[0]  # a second has the mean of its points
    np.testing.assert_allclose(first.times, [7.5, 8.5, 9.5])
    np.testing.assert_allclose(first.middles - [550_000, 5_802_000, 60], POINTS[:3], atol=1e-6)
    np.testing.assert_allclose(first.centre - [550_000, 5_802_000, 60], POINTS[:3].mean(axis=0), atol=1e-6)


def test_files_and_sources_tell_passes_apart(headers):
    by_file, by_source = (survey(headers, by, 20.0, silent) for by in ("file", "source"))
    assert [each.name for each in by_file.passes] == ["a.las", "b.las"]
    assert numbers(by_file, headers) == [1, 1, 1, 0, 0, 0]
    assert [each.name for each in by_source.passes] == ["source 3", "source 7"]
    assert numbers(by_source, headers) == [1, 1, 0, 0, 0, 1]
    assert by_file.are_apart
    assert not by_source.are_apart


def test_what_is_refused(tmp_path, headers, write_las, monkeypatch):
    untimed = open_headers([write_las(tmp_path / "c.las", POINTS, TIMES, point_format=0, version="1.2")])
    with pytest.raises(OptionError, match="--passes file"):
        survey(untimed, "time", 20.0, silent)
    assert survey(untimed, "file", 20.0, silent).passes[0].times.tolist() == [0.5]
    text = tmp_path / "a.xyz"
    text.write_text("1 2 3\n4 5 6\n")
    with pytest.raises(FileError, match="Expected LAS or LAZ"):
        survey(open_headers([text]), "file", 20.0, silent)
    with pytest.raises(OptionError, match="time, source, file"):
        survey(headers, "colour", 20.0, silent)
    not_finite = write_las(tmp_path / "nan.las", POINTS, np.where(TIMES == 9.1, np.nan, TIMES))
    with pytest.raises(FileError, match="finite times"):
        survey(open_headers([not_finite]), "time", 20.0, silent)
    monkeypatch.setattr("maxcon.mapping.align.passes.MOST_SECONDS", 4)  # times that are none fill the memory
    with pytest.raises(OptionError, match="Are these times"):
        survey(headers, "time", 20.0, silent)
