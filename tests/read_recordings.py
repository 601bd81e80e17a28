"""Recordings of Rerun, read back by its own reader."""

import pyarrow

__all__ = ["logged", "shown_views"]


def logged(path):
    """For each entity and component the rows (epoch, stamp in ns, value), in order; epoch and stamp None if static."""
    found = {}
    for chunk in _reader(path).stream():
        table = chunk.to_record_batch()
        names = table.schema.names
        times = [_whole_numbers(table, line) for line in ("epoch", "stamp")]
        for name in (name for name in names if ":" in name):
            rows = zip(*times, map(_value, table.column(name)), strict=True)
            key = chunk.entity_path, name.partition(":")[2]
            found.setdefault(key, []).extend(row for row in rows if row[2] is not None)
    return {key: sorted(rows, key=lambda row: row[0] or 0) for key, rows in found.items()}


def shown_views(path):
    """Classes of the views that open, with their names."""
    (store,) = _reader(path).blueprints()
    tables = [chunk.to_record_batch() for chunk in _reader(path).stream(store=store)]
    columns = ("ViewBlueprint:class_identifier", "ViewBlueprint:display_name")
    views = [[of.column(name)[0].as_py()[0] for name in columns] for of in tables if columns[0] in of.schema.names]
    return dict(views)


def _reader(path):
    from rerun.chunk import RrdReader

    return RrdReader(path)


def _whole_numbers(table, name):
    return table.column(name).cast("int64").to_pylist() if name in table.schema.names else [None] * len(table)


def _value(cell):
    """A list, or of points an array, shape (n, 3)."""
    if cell.is_valid and pyarrow.types.is_fixed_size_list(cell.type.value_type):
        return cell.values.flatten().to_numpy().reshape(-1, cell.type.value_type.list_size)
    return cell.as_py()
