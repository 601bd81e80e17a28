# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Worlds as datasets on disk: clouds of the map, scans, recordings, reference and priors."""
