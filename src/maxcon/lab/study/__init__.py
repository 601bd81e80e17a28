"""A study: methods x epochs of a dataset, in one table."""

from maxcon.lab.study.methods import (
    DEFAULT_SETS,
    METHOD_SETS,
    StudyMethod,
    choose_methods,
    installed_methods,
    known_methods,
    refined_words,
)
from maxcon.lab.study.run import Study, run_study
from maxcon.lab.study.table import COLUMNS, MethodRows, MethodStatistics, rows_by_method, statistics

__all__ = [
    "COLUMNS", "DEFAULT_SETS", "METHOD_SETS", "MethodRows", "MethodStatistics", "Study", "StudyMethod",
    "choose_methods", "installed_methods", "known_methods", "refined_words", "rows_by_method", "run_study",
    "statistics",
]  # fmt: skip
