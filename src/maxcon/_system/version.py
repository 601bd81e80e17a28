# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The version, at the bottom of the house where everybody may read it."""

__all__ = ["__version__"]

__version__ = "0.1.0"
