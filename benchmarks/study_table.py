# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The table of a study as Markdown, for docs/: python benchmarks/study_table.py STUDY [--distinct] [METHOD...]"""

import argparse
import math

from maxcon.lab.study import Study, rows_by_method, statistics


def shown(value, digits):
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def header(columns):
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"


def accuracy_rows(found):
    columns = ("prior", "method", "success", "%", "trusted", "of these wrong", "median m", "95 % m", "worst m")
    yield from header((*columns, "heading 95 % deg", "ms"))
    for method in found:
        yield (
            f"| {method.prior} | {method.method} | {method.n_success} of {method.n_epochs}"
            f" | {100.0 * method.n_success / method.n_epochs:.1f} | {method.n_localized} | {method.n_false}"
            f" | {shown(method.distance.median, 3)} | {shown(method.distance.p95, 3)}"
            f" | {shown(method.distance.worst, 2)} | {shown(math.degrees(method.heading_error.p95), 2)}"
            f" | {shown(method.ms.median, 0)} |"
        )


def distinct_rows(found):
    yield from header(("prior", "method", "epochs", "peak ratio", "kurtosis", "divergence nat", "spread m"))
    for method in found:
        if not math.isnan(method.kurtosis.median):
            yield (
                f"| {method.prior} | {method.method} | {method.n_epochs} | {method.peak_ratio.median:.3f}"
                f" | {method.kurtosis.median:.2f} | {method.divergence.median:.1f} | {method.spread.median:.2f} |"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study")
    parser.add_argument("methods", nargs="*")
    parser.add_argument("--distinct", action="store_true")
    arguments = parser.parse_args()
    study = Study.open(arguments.study)
    found = [statistics(rows) for rows in rows_by_method(study.table, tuple(study.configuration.methods))]
    found = [method for method in found if not arguments.methods or method.method in arguments.methods]
    for line in distinct_rows(found) if arguments.distinct else accuracy_rows(found):
        print(line)


if __name__ == "__main__":
    main()
