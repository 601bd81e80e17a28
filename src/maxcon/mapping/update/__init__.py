"""Map update: surfaces that localized drives see through become gone, and those they hit anew become new."""

from maxcon.mapping.update.observations import LocalizedDrive, UpdateOptions
from maxcon.mapping.update.update import update_map

__all__ = ["LocalizedDrive", "UpdateOptions", "update_map"]
