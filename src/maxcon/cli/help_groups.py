# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Help of commands with many options: in groups, as plain text."""

from typing import Any, ClassVar

from typer.core import TyperCommand

__all__ = ["GROUPS", "GroupedCommand", "MapCommand"]

GROUPS = {
    "Inputs": "drives prior times trajectory min_range max_range max_gap epochs signed_normals crs to_crs area"
    " keep_every",
    "Recordings and scanners": "topic prior_topic prior_frames odometry_topic odometry_frames geoid_height mounting"
    " at_stamp",
    "Rounds": "rounds pause georeference_sigma georeference_sigma_deg drift_sigma knots",
    "Classes": "drop keep_all vehicle_class asprs_classes classify",
    "Method": "methods objective multiplicity weighting thinning search refinement known_only",
    "Search space": "around radius half_width heading_half_width_deg height_half_width sigma_position"
    " sigma_heading_deg sigmas largest_half_width wider cell heading_step_deg",
    "Motion": "track odometry drift deskew turn_time",
    "Certainty": "risk least_share largest_runner_up sigma",
    "Output": "out resume overwrite tum plot plot_epochs quiet",
    "How it is done": "threads workers scheduler",
}
"""Names of the options' parameters, by the group they are in."""
MAP, OTHERS = "Map", "Options"
_GROUP_OF = {name: group for group, names in GROUPS.items() for name in names.split()}


class GroupedCommand(TyperCommand):
    """A command that lists its options in groups, others last."""

    group_of: ClassVar[dict[str, str]] = _GROUP_OF

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        names = ("Arguments", *GROUPS, MAP, OTHERS)
        groups: dict[str, list[tuple[str, str]]] = {name: [] for name in names}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            is_argument = parameter.param_type_name == "argument"
            if record is not None:
                groups["Arguments" if is_argument else self.group_of.get(parameter.name or "", OTHERS)].append(record)
        for name, records in groups.items():
            if records:
                with formatter.section(name):
                    formatter.write_dl(records)


class MapCommand(GroupedCommand):
    """A command whose cell and sigma are those of the map that it makes."""

    group_of = _GROUP_OF | dict.fromkeys(("cell", "sigma"), MAP)
