# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What stands in a city or a suburb, as triangles with classes."""
