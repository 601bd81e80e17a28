# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What pictures and pages share: how they look, the map from above, marks of methods, names of objectives."""
