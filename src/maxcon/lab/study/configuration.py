# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The configuration of a study, saved beside its table; the study can be continued with the same one only."""

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict

from maxcon._system.atomic import write_json
from maxcon._system.checked import checked, read_json
from maxcon._system.regular_file import sha256_of_file
from maxcon._system.resumable import describe, differences
from maxcon._system.version import __version__
from maxcon.drive.localize import DriveOptions
from maxcon.errors import FileError, OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.methods import MAP_VARIANTS, StudyMethod

CONFIGURATION = "study.json"
LARGEST = 2**24
"""Bytes."""
MAP_AND_SCANS = "description of map and scans"


class Run(TypedDict, total=False):
    """One run of a study; rows made, and seconds, once it is done."""

    methods: list[str]
    priors: list[str]
    n_epochs: int
    n_workers: int
    n_rows: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Configuration:
    """Everything that a study was run with.

    parts: hashes of what the dataset is made of: its description of map and scans, its reference and each prior.
    options: range limits of the scans, and gaps of prior and reference to interpolate across.
    methods: description of each method, by its name, in the order of the table.
    maps: how each map differs, by its name.
    """

    version: str
    dataset: str
    parts: dict[str, str]
    n_scans: int
    options: dict[str, float] = field(default_factory=dict)
    methods: dict[str, dict[str, Any]] = field(default_factory=dict)
    maps: dict[str, dict[str, Any]] = field(default_factory=dict)
    runs: list[Run] = field(default_factory=list)

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
        """Return the configuration of the study in a folder; FileError if there is none."""
        what, advice = "a study", "Make one with maxcon study DATASET -o STUDY"
        path = folder / CONFIGURATION
        return checked(read_json(path, what, advice, LARGEST), cls, path, what, advice)

    def write(self, folder: Path) -> None:
        """Write it into the folder of a study."""
        write_json(folder / CONFIGURATION, asdict(self))

    def joined(self, other: "Configuration", with_rows: Collection[str]) -> "Configuration":
        """Return this configuration with the methods of the run that begins; OptionError if it is another study.

        Methods `with_rows` must be as before. Without any, priors and reference may have changed.
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
        parts = self.parts if with_rows else {MAP_AND_SCANS: self.parts.get(MAP_AND_SCANS, "")}
        check_parts(parts, other.parts)
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
            parts=parts | other.parts,
            methods=kept | other.methods,
            maps=self.maps | other.maps,
        )


def dataset_parts(dataset: Dataset) -> dict[str, str]:
    """Return hashes of the parts of a dataset that a study depends on; scans and clouds are too large for one."""
    described = {name: value for name, value in asdict(dataset).items() if name not in ("path", "priors")}
    inside = dataset.folder.resolve()
    words = json.dumps(described, default=lambda path: str(path.resolve()).removeprefix(str(inside)), sort_keys=True)
    files = {"reference": dataset.reference, **{f"prior {name}": path for name, path in dataset.priors.items()}}
    try:
        checksums = {name: sha256_of_file(path) for name, path in files.items()}
    except OSError as error:
        raise FileError(
            f"Expected to be able to read {error.filename}, got: {error.strerror}. Check it and its permissions."
        ) from error
    return {MAP_AND_SCANS: hashlib.sha256(words.encode()).hexdigest(), **checksums}


def check_parts(mine: Mapping[str, str], theirs: Mapping[str, str]) -> None:
    """Refuse a dataset whose parts are not those of a study; other priors may come."""
    for name in mine.keys() & theirs.keys():
        if mine[name] != theirs[name]:
            raise OptionError(
                f"Expected the {name} of the dataset to be as before in this study, but it has changed."
                " Name another folder for a new study."
            )
