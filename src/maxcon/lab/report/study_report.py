"""A study's report: figures made, and the page written."""

import json
import math
import os
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from maxcon._system import Progress
from maxcon._system.atomic import check_folder, check_writable, make_folder, sweep
from maxcon._system.resumable import describe
from maxcon._system.version import __version__
from maxcon.errors import OptionError
from maxcon.lab.dataset import DESCRIPTION
from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.lab.report import check_jinja2, page_words, write_page
from maxcon.lab.report.claims import COUNT, HELMERT, paper_claims
from maxcon.lab.report.study_figures import certainty_of, draw_statistics, own_methods
from maxcon.lab.report.study_scenes import draw_scenes, open_scenes, space_of
from maxcon.lab.study import METHOD_SETS, MethodRows, MethodStatistics, Study, refined_words, rows_by_method, statistics
from maxcon.lab.study.bench import REFERENCE
from maxcon.plotting.figure import check_matplotlib
from maxcon.search.objectives import Objective
from maxcon.search.space import SearchSpace

FEW_EPOCHS = 50
MAIN_METHODS = ("maxcon", HELMERT, COUNT, "helmert-occupied", "icp-plane-1m", "icp-plane-3m", "gicp-3m")
WITHOUT_GROUND = ("helmert-occupied", "icp-plane-1m", "icp-plane-3m", "gicp-3m")
"""Methods that are shown beside those with the ground in the map."""


def report_study(
    study_folder: str | os.PathLike[str], path: str | os.PathLike[str], *,
    figures: str | os.PathLike[str] | None = None, dataset: str | os.PathLike[str] | None = None,
    prior: str | None = None, objective: Objective | None = None, progress: Progress | None = None,
) -> Path:  # fmt: skip
    """Write the page of a study (HTML), and its figures beside it; return the folder of the figures.

    study_folder: what `run_study` made, done or not.
    figures: folder for the figures, SVG; named after the page if None.
    dataset: where the dataset is now; where it was if None. Without it the scenes are left out, and the page says so.
    prior: the prior that figures and claims are about; the first of the study if None. Tables have all.
    objective: the user's own, drawn beside count and Helmert's score.
    """
    check_matplotlib()
    check_jinja2()
    page = Path(path)
    folder = page.with_name(f"{page.stem}-figures") if figures is None else Path(figures)
    if page.suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"Expected the name of a page to end in .html, got {os.fspath(path)!r}. Rename it.")
    check_writable(page)
    check_folder(folder)
    study = Study.open(study_folder)
    by_prior = _by_prior(study)
    if prior is not None and prior not in by_prior:
        raise OptionError(f"Expected a prior of the study, {', '.join(by_prior)}, got {prior!r}.")
    prior = prior or next(iter(by_prior))
    methods = by_prior[prior]
    make_folder(folder)
    sweep(folder)
    report = progress or (lambda step, done, total: None)
    notes = _cautions(study, methods)
    made = [method["method"] for method in study.configuration.methods.values()]
    studied = [method.get("objective") for method in made if isinstance(method, dict)]
    if objective is not None and describe(objective) not in studied:
        notes.append("The objective in the pictures is not in the tables: it was not studied, or was edited since.")
    scenes = open_scenes(study, dataset, prior, notes, objective)
    report("drawing", 0, 2)
    drawn = [] if scenes is None else draw_scenes(folder, scenes, methods, notes)
    report("drawing", 1, 2)
    pictures = draw_statistics(folder, methods, None if scenes is None else scenes.point_map)
    if not pictures:
        notes.append("No figures over all epochs: no epoch has an answer and a reference.")
    report("drawing", 2, 2)
    certainty = certainty_of(folder, by_prior, prior, study.configuration.methods)
    space = space_of(study.configuration.methods, HELMERT) or SearchSpace.paper()
    numbers = {name: [statistics(rows) for rows in methods.values()] for name, methods in by_prior.items()}
    main = [*own_methods(methods), *(name for name in MAIN_METHODS if name in methods)]
    page_of = {
        "title": f"maxcon study: {_name(study)}", "name": _name(study), "prior": prior,
        "success": SUCCESS_WORDS, "table": study.table,
        "main": [statistics(methods[name]) for name in main or list(methods)[:6]],
        "epochs": {epoch for rows in methods.values() for epoch in rows.numbers("epoch").tolist()},
        "study": study.configuration, "claims": paper_claims(methods, space.cell_edge, by_prior.get(REFERENCE)),
        "tables": [table for name, found in numbers.items() for table in method_tables(name, found)],
        "scenes": drawn, "statistics": pictures, "certainty": certainty, "notes": notes,
        "reasons": _reasons(by_prior), "configuration": json.dumps(study.configuration.runs, indent=1),
        "command": _command(study_folder, path, figures=figures, dataset=dataset, prior=prior), "version": __version__,
    }  # fmt: skip
    write_page(page, "study.html.j2", page_of)
    return folder


def _by_prior(study: Study) -> dict[str, dict[str, MethodRows]]:
    """Rows by prior and by method: priors in the order they were studied, the reference last; own methods first."""
    found: dict[str, dict[str, MethodRows]] = {}
    names = study.configuration.methods
    for rows in rows_by_method(study.table, tuple(dict.fromkeys([*own_methods(names), *names]))):
        found.setdefault(rows.prior, {})[rows.method] = rows
    if not found:
        raise OptionError(
            f"Expected rows in the study {study.folder}, got none yet. Let it run: maxcon study DATASET -o STUDY."
        )
    studied = [str(name) for run in study.configuration.runs for name in run.get("priors", ())]
    order = sorted(found, key=lambda name: (name == REFERENCE, (*studied, name).index(name), name))
    return {name: found[name] for name in order}


def _cautions(study: Study, methods: dict[str, MethodRows]) -> list[str]:
    """Return notes of what weakens the verdicts: an unfinished study, few epochs, methods with different epochs."""
    notes = list(filter(None, [refined_words(study.configuration.methods)]))
    if any("n_rows" not in run for run in study.configuration.runs[-1:]):
        notes.append("This study is not finished, or was stopped: the same maxcon study command goes on.")
    n_epochs = {len(rows) for rows in methods.values()}
    if min(n_epochs) < FEW_EPOCHS:
        notes.append(f"Some methods have {min(n_epochs)} epochs only: rates from so few say little.")
    if len(n_epochs) > 1:
        notes.append("Not all methods were studied over the same epochs; the tables say over how many.")
    return notes


def _command(study_folder: str | os.PathLike[str], path: str | os.PathLike[str], **options: object) -> str:
    """What to type to get the page again."""
    words = ["maxcon", "report", os.fspath(study_folder), "-o", os.fspath(path)]
    for name, value in options.items():
        words += [f"--{name}", str(value)] if value is not None else []
    return shlex.join(words)


def _name(study: Study) -> str:
    """Name of the dataset: that of its folder, or of its description if that has not the usual name."""
    path = Path(study.configuration.dataset)
    return path.parent.name if path.name == DESCRIPTION else path.stem


def _reasons(by_prior: dict[str, dict[str, MethodRows]]) -> tuple[tuple[str, int], ...]:
    """Why rows have no answer: each status with how many rows it has, and one reason as an example."""
    counted: Counter[str] = Counter()
    example: dict[str, str] = {}
    for rows in (rows for methods in by_prior.values() for rows in methods.values()):
        for status, reason, x in zip(rows.words("status"), rows.words("reason"), rows.numbers("x"), strict=True):
            if math.isnan(x):
                counted[str(status)] += 1
                if reason:
                    example.setdefault(str(status), reason)
    return tuple(
        (f"{status}, such as: {example[status]}" if status in example else status, n_rows)
        for status, n_rows in counted.most_common()
    )


def method_tables(prior: str, found: Sequence[MethodStatistics]) -> list[dict[str, Any]]:
    """Return the tables of one prior: that of the methods, and one for each question that the study answers."""
    by_name = {method.method: method for method in found}
    questions = page_words()["tables"]
    asked = {name: [by_name[one] for one in METHOD_SETS[name] if one in by_name] for name in questions}
    asked["ground"] += [by_name[name] for name in WITHOUT_GROUND if name in by_name]
    only_asked = {name for question in questions for name in METHOD_SETS[question]} - set(METHOD_SETS["consensus"])
    plain = [method for method in found if method.method not in only_asked]
    tables = [_table(f"Methods, prior “{prior}”", "", plain)] if plain else []
    for name, question in questions.items():
        if any(method.method in only_asked for method in asked[name]):
            tables.append(_table(f"{question['title']}, prior “{prior}”", question["words"], asked[name]))
    return tables


def _table(title: str, words: str, methods: Sequence[MethodStatistics]) -> dict[str, Any]:
    """A table: what is compared and how to read it, a row per method, and which columns have values."""
    has_distinctness = any(not math.isnan(method.kurtosis.median) for method in methods)
    return {
        "title": title, "words": words, "methods": methods, "has_distinctness": has_distinctness,
        "has_starts": any(method.n_starts for method in methods),
    }  # fmt: skip
