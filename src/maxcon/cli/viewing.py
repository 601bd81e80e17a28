# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Drives that are shown while they are localized, or recorded for a viewer."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from maxcon.cli.flags import OptionGroup, check_exclusive, check_needs, flag
from maxcon.errors import OptionError


class ViewOptions(OptionGroup, title="Output"):
    """Whether a drive is shown, or recorded; both need the extra view."""

    view: bool = flag(False, "Show the map, and of a drive scans and answers as they come, in Rerun (extra view).")
    save: Path | None = flag(
        None, "Write what --view shows as a recording; `rerun FILE` opens it (extra view).", metavar="FILE.rrd"
    )

    @property
    def is_wanted(self) -> bool:
        """Whether epochs are shown."""
        return self.view or self.save is not None

    def check(self, *, resume: bool = False) -> None:
        """Refuse, before the work, what cannot be shown or written."""
        if not self.is_wanted:
            return
        from maxcon._system.atomic import check_writable
        from maxcon.export.scene import RERUN_SUFFIX, with_rerun

        check_exclusive({"--save": self.save}, {"--view": self.view, "--resume": resume})
        rerun_recording = with_rerun()
        if self.save is None:
            rerun_recording.find_viewer()
        elif self.save.suffix.lower() != RERUN_SUFFIX:
            raise OptionError(f"Expected a recording {RERUN_SUFFIX} as --save, got {self.save}. Rename it.")
        else:
            check_writable(self.save)

    def shown(self, epochs: Any, point_map: Any, near: Any, *scored: Any) -> AbstractContextManager[Any]:
        """Return what yields the same epochs, shown if that is wanted; parameters as of `rerun_recording.shown`."""
        from maxcon.export.scene import with_rerun

        is_wanted = self.is_wanted
        return with_rerun().shown(epochs, point_map, near, self.save, *scored) if is_wanted else nullcontext(epochs)


class ScoresOptions(ViewOptions, title="Output"):
    """Whether scores of cells are shown, too."""

    scores: bool = flag(False, "With --view or --save: show the cells' scores, too, searched anew, some 0.1 s a scan.")

    def __post_init__(self) -> None:
        check_needs({"--scores": self.scores}, {"--view": self.view, "--save": self.save})
