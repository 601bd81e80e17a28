# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One picture a module: of an epoch, of a drive, or of many epochs and methods."""
