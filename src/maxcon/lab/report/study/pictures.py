# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Draws those pictures of a study that its data allow; for others there is a note, and the page goes without them."""

import os
from collections.abc import Mapping
from pathlib import Path

from maxcon._system.progress import Progress
from maxcon.drive.localize import DriveOptions
from maxcon.errors import FileError, MaxconError
from maxcon.lab.dataset import Dataset
from maxcon.lab.report.html import Picture
from maxcon.lab.report.study.claims import HELMERT
from maxcon.lab.report.study.picked_epochs import pick_epochs
from maxcon.lab.report.study.scenes import StudyScenes, space_of
from maxcon.lab.report.study.statistics import draw_statistics
from maxcon.lab.study import MethodRows, Study
from maxcon.lab.study.bench import REFERENCE, BenchPlan
from maxcon.lab.study.configuration import check_parts, dataset_parts
from maxcon.lab.study.map_variants import STANDARD

__all__ = ["draw_pictures", "open_scenes"]


def open_scenes(
    study: Study, dataset: str | os.PathLike[str] | None, prior: str, notes: list[str]
) -> StudyScenes | None:
    """Open the dataset of a study for its scenes; None, and a note, if it is missing or not the one studied.

    study: what was run.
    dataset: where the dataset is now; where it was if None.
    prior: name of the prior of the pictures.
    notes: what cannot be shown, and why, is added.
    """
    configuration = study.configuration
    name = next((name for name in (HELMERT, "helmert-occupied") if name in configuration.methods), None)
    space = space_of(configuration.methods, name or "")
    if name is None or space is None:
        notes.append("No scenes: the study has neither helmert-points nor helmert-occupied.")
        return None
    try:
        opened = Dataset.open(dataset or configuration.dataset)
        check_parts(configuration.parts, dataset_parts(opened))
        if prior not in (*opened.priors, REFERENCE):
            raise FileError(f"Expected the prior {prior} in {opened.path}, got {', '.join(opened.priors)}.")
        path = opened.map_path or study.folder / "maps" / f"{STANDARD}.map"
        bench = BenchPlan(opened, {STANDARD: path}, DriveOptions(**configuration.options)).open()
        if len(bench.scans) != configuration.n_scans:
            raise FileError(
                f"Expected the {configuration.n_scans} scans of the study in {opened.scans}, got {len(bench.scans)}."
            )
    except MaxconError as error:
        if dataset is not None:
            raise
        notes.append(f"No scenes: {error} If the dataset was moved: maxcon report --dataset DATASET.")
        return None
    return StudyScenes(bench, prior, bench.maps[STANDARD], space, name.partition("-")[2])


def draw_pictures(
    folder: Path, scenes: StudyScenes | None, methods: Mapping[str, MethodRows], notes: list[str], progress: Progress
) -> tuple[list[Picture], list[Picture]]:
    """Draw scenes and statistics into a folder; return both.

    folder: must exist.
    scenes: the dataset, opened.
    methods: by name, one prior.
    notes: what cannot be shown, and why, is added.
    progress: called with (step, done, of how many).
    """
    progress("drawing", 0, 2)
    drawn = _draw_scenes(folder, scenes, methods, notes) if scenes is not None else []
    progress("drawing", 1, 2)
    pictures = draw_statistics(folder, methods, scenes.point_map if scenes is not None else None)
    if not pictures:
        notes.append("No figures over all epochs: no epoch has an answer and a reference.")
    progress("drawing", 2, 2)
    return drawn, pictures


def _draw_scenes(
    folder: Path, scenes: StudyScenes, methods: Mapping[str, MethodRows], notes: list[str]
) -> list[Picture]:
    """Draw overview, headings and comparison."""
    helmert, count = (methods.get(f"{name}-{scenes.multiplicity}") for name in ("helmert", "count"))
    epochs = pick_epochs(count, helmert) if count is not None and helmert is not None else None
    if epochs is None or helmert is None:
        notes.append(
            f"No scenes: no epoch where both count-{scenes.multiplicity} and helmert-{scenes.multiplicity} succeed."
        )
        return []
    try:
        return [
            scenes.overview(folder / "scene.svg", epochs.street, helmert),
            scenes.headings(folder / "headings.svg", epochs.crossing),
            scenes.comparison(folder / "comparison.svg", epochs),
        ]
    except MaxconError as error:
        notes.append(f"Scenes are missing: {error}")
        return []
