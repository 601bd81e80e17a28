# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Recordings of drives: bags, MCAP files and packet captures, read without what recorded them."""
