# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The configuration of a study, saved beside its table; the study can be continued with the same one only."""

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from maxcon._system.atomic import write_json
from maxcon._system.regular_file import open_regular
from maxcon._system.resumable import differences
from maxcon._system.version import __version__
from maxcon.drive.localize import DriveOptions
from maxcon.drive.poses_dataset import describe
from maxcon.errors import FileError, OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.methods import MAP_VARIANTS, StudyMethod

__all__ = ["CONFIGURATION", "Configuration", "check_parts", "dataset_parts"]

CONFIGURATION = "study.json"
LARGEST_CONFIGURATION = 2**24
MAP_AND_SCANS = "description of map and scans"


@dataclass(frozen=True)
class Configuration:
    """Everything that a study was run with.

    version: of maxcon.
    dataset: path of the dataset's TOML file.
    parts: hashes of what the dataset is made of: its description of map and scans, its reference and each prior.
    n_scans: scans in the dataset.
    options: range limits of the scans, and gaps of prior and reference to interpolate across.
    methods: description of each method, by its name, in the order of the table.
    maps: how each map differs, by its name.
    runs: each run: methods, priors, number of epochs, processes; and seconds and rows made, once it is done.
    """

    version: str
    dataset: str
    parts: dict[str, str]
    n_scans: int
    options: dict[str, Any] = field(default_factory=dict)
    methods: dict[str, Any] = field(default_factory=dict)
    maps: dict[str, Any] = field(default_factory=dict)
    runs: list[dict[str, Any]] = field(default_factory=list)

    @classmethod
    def of(
        cls, dataset: Dataset, n_scans: int, options: DriveOptions, methods: Sequence[StudyMethod]
    ) -> "Configuration":
        """Return the configuration of a study that begins."""
        return cls(
            __version__,
            str(dataset.path.resolve()),
            dataset_parts(dataset),
            n_scans,
            describe(asdict(options)),
            {
                method.name: {
                    "method": describe(method.method),
                    "map": method.map_name,
                    "starts": "around the reference" if method.around_reference else "from the prior",
                }
                for method in methods
            },
            {
                name: {"path": str(dataset.map_path)} if dataset.map_path else describe(MAP_VARIANTS[name])
                for name in dict.fromkeys(method.map_name for method in methods)
            },
        )

    @classmethod
    def read(cls, folder: Path) -> "Configuration":
        """Return the configuration of the study in a folder."""
        path = folder / CONFIGURATION
        try:
            with open_regular(path) as stream:
                text = stream.read(LARGEST_CONFIGURATION + 1)
            named = json.loads(text.decode("utf-8"))
            found = cls(**named)
            found._check_kinds()
        except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise FileError(
                f"Expected a study in {folder}, got: {reason} ({path.name})."
                " Make one with maxcon study DATASET -o STUDY."
            ) from error
        return found

    def _check_kinds(self) -> None:
        """Refuse what another program has put into the file where names and numbers are expected."""
        tables = [self.parts, self.options, self.methods, self.maps]
        tables += [*_listed(self.methods), *_listed(self.runs)]
        words = [self.version, self.dataset, *_listed(self.parts)]
        words += [name for run in self.runs for key in ("priors", "methods") for name in run.get(key, ())]
        numbers = [self.n_scans, *_listed(self.options)]
        numbers += [run.get(key, 0) for run in self.runs for key in ("n_epochs", "n_workers", "n_rows", "seconds")]
        for values, kind, what in (
            (tables, dict, "a table"), (words, str, "a name"), (numbers, int | float, "a number"),
        ):  # fmt: skip
            wrong = [value for value in values if not isinstance(value, kind)]
            if wrong:
                raise TypeError(f"{str(wrong[0])[:40]!r} where {what} should be")

    def write(self, folder: Path) -> None:
        """Write it into the folder of a study."""
        write_json(folder / CONFIGURATION, asdict(self))

    def joined(self, other: "Configuration", with_rows: Collection[str]) -> "Configuration":
        """Return this configuration with the methods of another run of the same study.

        other: of the run that begins.
        with_rows: methods that have rows already: they must be the same as before. Without any, priors and reference
            may have changed: a run that was stopped, or refused, before its first row has made maps only.
        """
        for what, mine, theirs in (
            ("made by maxcon", self.version, other.version),
            ("of a dataset with scans", self.n_scans, other.n_scans),
            ("with the options", self.options, other.options),
        ):
            if mine != theirs:
                raise OptionError(
                    f"Expected to go on with the study {what} {mine}, got {theirs}."
                    " Name another folder for a new study."
                )
        mine = self.parts if with_rows else {MAP_AND_SCANS: self.parts.get(MAP_AND_SCANS, "")}
        check_parts(mine, other.parts)
        for name in other.methods:
            if name in with_rows and self.methods.get(name) != other.methods[name]:
                raise OptionError(
                    f"Expected {name} to be made as before in this study, with"
                    f" {differences(self.methods.get(name), other.methods[name])}. Name another folder, or give your"
                    " own method another name."
                )
        kept = {name: method for name, method in self.methods.items() if name in with_rows}
        return replace(
            self,
            dataset=other.dataset,
            parts=mine | other.parts,
            methods=kept | other.methods,
            maps=self.maps | other.maps,
        )

    def with_run(self, run: dict[str, Any]) -> "Configuration":
        """Return the configuration with one more run, which may be filled in later."""
        return replace(self, runs=[*self.runs, run])


def _listed(values: Any) -> list[Any]:
    """Return the values of a table, or of a list; none of anything else."""
    if isinstance(values, dict):
        return list(values.values())
    return values if isinstance(values, list) else []


def dataset_parts(dataset: Dataset) -> dict[str, str]:
    """Return hashes of the parts of a dataset that a study depends on; scans and clouds are too large for one."""
    described = {name: value for name, value in asdict(dataset).items() if name not in ("path", "priors")}
    inside = dataset.folder.resolve()
    words = json.dumps(described, default=lambda path: str(path.resolve()).removeprefix(str(inside)), sort_keys=True)
    files = {"reference": dataset.reference, **{f"prior {name}": path for name, path in dataset.priors.items()}}
    return {
        MAP_AND_SCANS: hashlib.sha256(words.encode()).hexdigest(),
        **{name: _checksum(path) for name, path in files.items()},
    }


def _checksum(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise FileError(
            f"Expected to be able to read {path}, got: {error.strerror or error}. Check it and its permissions."
        ) from error


def check_parts(mine: Mapping[str, str], theirs: Mapping[str, str]) -> None:
    """Refuse a dataset whose parts are not those of a study; other priors may come."""
    for name in mine.keys() & theirs.keys():
        if mine[name] != theirs[name]:
            raise OptionError(
                f"Expected the {name} of the dataset to be as before in this study, but it has changed."
                " Name another folder for a new study."
            )
