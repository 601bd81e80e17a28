# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_cloud: the suffix decides, and says so."""

import pytest

from maxcon.errors import FileError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud


def test_other_suffixes_are_refused_with_a_list_of_what_is_read(tmp_path):
    for name in ("a.pts", "a", "a.dxf"):
        (tmp_path / name).write_text("0 0 0")
        with pytest.raises(
            FileError, match=r"suffix \.las, \.laz, \.ply, \.npz, \.e57, \.xyz, \.csv, \.txt, got .*a.* Convert"
        ):
            open_cloud(tmp_path / name)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_no_file_a_folder_and_an_empty_file(tmp_path, suffix):
    with pytest.raises(FileError, match="no such file"):
        open_cloud(tmp_path / f"a{suffix}")
    (tmp_path / f"b{suffix}").mkdir()
    with pytest.raises(FileError, match="got the folder"):
        open_cloud(tmp_path / f"b{suffix}")
    (tmp_path / f"c{suffix}").touch()
    with pytest.raises(FileError, match=rf"c\{suffix}"):
        open_cloud(tmp_path / f"c{suffix}")
