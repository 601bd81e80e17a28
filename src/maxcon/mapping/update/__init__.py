# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Map upkeep: surfaces that localized drives saw through become gone, those they met anew become new (decision 31)."""

from maxcon.mapping.update.drives import LocalizedDrive
from maxcon.mapping.update.update import update_map
from maxcon.mapping.update.update_options import UpdateOptions

__all__ = ["LocalizedDrive", "UpdateOptions", "update_map"]
