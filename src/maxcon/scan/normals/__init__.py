# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of scans: planes through neighbouring points, turned to the sensor that measured them."""
