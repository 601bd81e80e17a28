# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Access to the files of a map, in a folder of this machine or on a network (decision 28)."""

from maxcon.map.storage.folder import Folder
from maxcon.map.storage.place import MapFiles, address_of, open_place
from maxcon.map.storage.record_place import RecordPlace

__all__ = ["Folder", "MapFiles", "RecordPlace", "address_of", "open_place"]
