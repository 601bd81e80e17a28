# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Reading and writing: point clouds, scans, trajectories and maps."""
