# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How vehicles drive through it, and how wrong what they know of that is: odometry, GNSS, post-processing."""
