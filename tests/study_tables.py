"""Small tables of a study, made by hand."""

import pyarrow

from maxcon.lab.study import rows_by_method
from maxcon.lab.study.table import table_schema


def study_table(rows):
    """The table of such rows; what they do not say is missing."""
    return pyarrow.Table.from_pylist(list(rows), schema=table_schema())


def rows_of(by_method, prior="gnss"):
    """Rows of methods, by name, epoch by epoch."""
    table = study_table(
        {"prior": prior, "method": name, "epoch": epoch, **row}
        for name, rows in by_method.items()
        for epoch, row in enumerate(rows)
    )
    return {found.method: found for found in rows_by_method(table)}
