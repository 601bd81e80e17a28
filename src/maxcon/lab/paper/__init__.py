# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The paper's figures and claims, drawn and checked for a study."""
