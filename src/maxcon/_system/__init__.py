# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What files, processes and compiled code need, whatever is computed: outputs in one step, locks, work gone on with."""
