# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One drive, epoch after epoch: localized, tracked or found without a prior; and its table of poses."""
