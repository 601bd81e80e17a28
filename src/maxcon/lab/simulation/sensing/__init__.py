# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What scanners measure of it: rays, layouts, and what moves while they turn."""
