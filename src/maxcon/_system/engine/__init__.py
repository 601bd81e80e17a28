# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The engine: tasks that can be done twice, in this process, in several on this machine, or on a dask cluster."""

from maxcon._system.engine.engine import Engine, n_processors
from maxcon._system.engine.job import Job

__all__ = ["Engine", "Job", "n_processors"]
