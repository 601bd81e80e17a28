# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Map upkeep: what drives saw through is gone, what they saw newly is new (decision 31)."""

from maxcon.upkeep.drives import LocalizedDrive, open_drives
from maxcon.upkeep.update import update_map
from maxcon.upkeep.update_options import UpdateOptions

__all__ = ["LocalizedDrive", "UpdateOptions", "open_drives", "update_map"]
