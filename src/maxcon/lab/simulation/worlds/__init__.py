# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scenes on two days with their traffic, the drives of the mapping vehicle and of the car."""
