# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Map upkeep: surfaces that localized drives saw through become gone, those they met anew become new (decision 31)."""

from maxcon.upkeep.drives import LocalizedDrive, open_drives
from maxcon.upkeep.update import update_map
from maxcon.upkeep.update_options import UpdateOptions

__all__ = ["LocalizedDrive", "UpdateOptions", "open_drives", "update_map"]
