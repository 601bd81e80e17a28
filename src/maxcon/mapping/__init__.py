# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From clouds and drives to maps: built, aligned, updated."""
