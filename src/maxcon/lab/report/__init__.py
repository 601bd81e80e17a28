# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pages of studies and of the demo, and the pictures in them; they need ``pip install 'maxcon[demo]'``."""
