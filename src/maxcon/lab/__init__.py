# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The laboratory: what it takes to study the method, and not to use it."""
