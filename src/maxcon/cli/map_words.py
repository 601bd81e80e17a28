"""What the map commands print of a map and of an alignment."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import typer

from maxcon.cli.terminal import print_rows
from maxcon.io.crs import LARGEST_INEXACTNESS, beyond_area_of_use, crs_code, crs_name
from maxcon.map import TILE_VOXELS
from maxcon.map.ground import ground_voxels
from maxcon.map.manifest import FORMAT_VERSION, Manifest
from maxcon.mapping.align import Alignment
from maxcon.mapping.build.options import class_name, found_ratios
from maxcon.mapping.build.point_statistics import MARGIN

MOST_PAIRS = 15  # in the printed table; residuals.csv has all
MOST_SOURCES = 20


def facts_of(manifest: Manifest) -> dict[str, Any]:
    """Return what a map is made of as numbers, and what its manifest says of the build."""
    edge, keys = TILE_VOXELS * manifest.cell, manifest.tiles.rows["key"]
    low, high = (corner * edge + manifest.origin[:2] for corner in (keys.min(axis=0), keys.max(axis=0) + 1))
    return {
        "cell": manifest.cell, "n_voxels": manifest.n_voxels, "n_points": manifest.n_points, "n_tiles": len(keys),
        "extent": [*low.tolist(), *high.tolist()], "origin": manifest.origin, "crs": crs_code(manifest.crs),
        "has_signed_normals": manifest.is_signed, "n_ground_heights": int(manifest.ground.rows["n_rows"].sum()),
        "sigma": manifest.sigma, "build": manifest.build,
    }  # fmt: skip


def print_manifest(manifest: Manifest) -> None:
    """Say what a map is made of."""
    edge, keys, build = TILE_VOXELS * manifest.cell, manifest.tiles.rows["key"], manifest.build
    x_low, y_low, x_high, y_high = facts_of(manifest)["extent"]
    signed = "turned to the sensor's side" if manifest.is_signed else "of unknown side: --trajectory tells it"
    n_files = sum(len(section.files) for section in manifest.sections.values())
    files = f"{n_files:,} file{'s' if n_files > 1 else ''} of format version {FORMAT_VERSION}"
    beyond = beyond_area_of_use(manifest.crs, 0.5 * (x_low + x_high), 0.5 * (y_low + y_high))
    rows = [
        ("voxels", f"{manifest.n_voxels:,} of {manifest.cell:g} m, from {manifest.n_points:,} points"),
        ("tiles", f"{len(keys):,} of {edge:g} m, in {files}"),
        ("extent", f"x {x_low:.1f} to {x_high:.1f}, y {y_low:.1f} to {y_high:.1f} m"),
        ("origin", ", ".join(f"{value:.12g}" for value in manifest.origin) + " m"),
        ("CRS", "; ".join(filter(None, [crs_name(manifest.crs), inexact_words(manifest), beyond]))),
        ("normals", f"{build.get('normals', 'unknown')}, {signed}"),
        ("ground", _ground(manifest)),
    ]
    if "spacing" in build:
        rows.append(("spacing", _spacing(build["spacing"], manifest.cell)))
    if "found" in build:
        rows.append(("found", _found(build["found"])))
    if placed := build.get("georeference"):
        heading = math.degrees(math.atan2(placed["rotation"][1][0], placed["rotation"][0][0]))
        parent = f"{placed['parent']['name']} {placed['parent']['sha256'][:8]} turned by {heading:.3f} degrees"
        words = f"{placed['n_places']:,} places, {placed['n_outliers']:,} outliers; known to {placed['sigma']:.3f} m"
        words += f", their coordinates by {operation['name']}" if (operation := placed.get("operation")) else ""
        rows.append(("placed", f"{parent} by {words}"))
    rows += [("sigma", sigma_words(manifest)), ("made by", str(build.get("program", "unknown")))]
    rows += rows_of_updates(build.get("updates", []))
    print_rows(rows)
    sources = build.get("sources", [])
    print_rows(("source", _source(source, is_found="found" in build)) for source in sources[:MOST_SOURCES])
    if len(sources) > MOST_SOURCES:
        typer.echo(f"{'':<12} {len(sources) - MOST_SOURCES} more sources in manifest.json")


def inexact_words(manifest: Manifest) -> str:
    """A warning that coordinates came into the map's CRS inexactly; nothing if they did not."""
    parts = [*manifest.build.get("sources", []), manifest.build.get("georeference", {})]
    found = [operation["accuracy"] for part in parts if (operation := part.get("operation"))]
    worst = -1.0 if min(found, default=0.0) < 0.0 else max(found, default=0.0)
    if 0.0 <= worst <= LARGEST_INEXACTNESS:
        return ""
    return f"warning: PROJ's operation may have put it off by {f'{worst:g} m' if worst > 0.0 else 'any distance'}"


def rows_of_updates(updates: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return what of a map is gone and new, and how it came so: names and words."""
    if not updates:
        return []
    last = updates[-1]
    counts = {name: last[f"n_{name}"] for name in ("known", "gone", "new")}
    total = max(sum(counts.values()), 1)
    rows = [(name, f"{count:,} voxels, {100.0 * count / total:.2f} %") for name, count in counts.items()]
    for number, each in enumerate(updates, 1):
        drives = ", ".join(f"{drive['name']} ({drive['n_looks']:,} looks)" for drive in each["drives"])
        changed = f"{each['n_now_gone']:,} gone, {each['n_now_new']:,} new, {each['n_back']:,} back"
        parent = f"{each['parent']['name']} {each['parent']['sha256'][:8]}"
        rows.append(("update", f"{number} of {parent} by {drives}: {each['n_judged']:,} seen, {changed}"))
    return rows


def _ground(manifest: Manifest) -> str:
    if not len(manifest.ground):
        return "not known: heights and tilts of priors are taken as they are"
    origin = manifest.build.get("ground", "unknown")
    n_heights = manifest.ground.rows["n_rows"].sum()
    return f"{n_heights:,} heights in cells of {ground_voxels(manifest.cell) * manifest.cell:g} m, {origin}"


def _spacing(spacing: Mapping[str, Any], cell: float) -> str:
    """How far apart the points lie, and whether the voxels suit that."""
    median, at_90, suits = spacing["median"], spacing["at_90"], spacing["suits_cell"]
    if at_90 >= MARGIN:
        return (
            f"points lie {median:.3f} m apart in the median, more than a tenth of them {MARGIN:g} m or more: too sparse"
            " for surfaces, few scans will match"
        )
    words = f"points lie {median:.3f} m apart in the median, 90 % of them within {at_90:.3f} m: "
    if cell < 0.7 * suits:
        return words + f"surfaces have holes in voxels of {cell:g} m; --cell {suits:g} suits them"
    return words + f"voxels of {cell:g} m have few holes"


def _found(found: Mapping[str, Any]) -> str:
    """Ratios of the points in each class that the build found."""
    ratios = found_ratios(found["n_points"], found["dropped"])
    text = ", ".join(f"{name} {100.0 * ratio:.0f} %" for name, ratio in ratios)
    return text + (f"; temporary objects cannot be found: {found['temporary']}" if found["temporary"] else "")


def sigma_words(manifest: Manifest) -> str:
    """How well the map is known, and from what."""
    known = manifest.build.get("sigma", {"from": "it does not say from what"})
    if known["from"] == "passes":
        return (
            f"{manifest.sigma:.3f} m, from {known['n_passes']} passes of {known['sigma_of_pass']:.3f} m each,"
            f" compared at {known['n_places']:,} places"
        )
    words = {
        "assumed": f"assumed: {known.get('reason')}; say it with --sigma",
        "georeference": "the map's own and that of its georeference",
        "alignment": "from alignment.json beside the clouds: aligned passes agree better than that",
    }
    return f"{manifest.sigma:g} m, {words.get(known['from'], known['from'])}"


def assumed_words(manifest: Manifest) -> str:
    """A warning that a map's sigma is assumed, as every covariance contains it; nothing if it is known."""
    if manifest.build.get("sigma", {}).get("from") != "assumed":
        return ""
    return f"each covariance contains {manifest.sigma:g} m that are only assumed of the map (map build --sigma)"


def _source(source: Mapping[str, Any], *, is_found: bool) -> str:
    """What was taken of a cloud and what not."""

    def counted(name: str, words: str) -> str:
        return f"{source[name]:,} {words}" if source.get(name) else ""

    dropped = ", ".join(f"{n:,} {class_name(int(key))}" for key, n in source["n_dropped"].items())
    invalid = counted("n_invalid", "without finite coordinates")
    parts = [
        f"{source['name']}: {source['n_points']:,} points, {source['n_kept']:,} kept",
        dropped and f"dropped {dropped}",
        invalid and f"dropped {invalid}",
        counted("n_outside", "outside of the area"),
        source.get("transform", ""),
        counted("n_thinned", "thinned out"),
        counted("n_withheld", "marked as withheld"),
        counted("n_without_side", "without a pose near their time"),
        "" if source["is_classified"] or is_found or source["n_points"] == source.get("n_outside")
        else "no ASPRS classes: ground, vegetation and vehicles were not dropped",
    ]  # fmt: skip
    return "; ".join(filter(None, parts))


def print_alignment(found: Alignment) -> None:
    """Say how far passes lay apart and lie apart, and what that means for a map."""
    drift = found.adjusted.drift_sigma
    matches = f"{len(found.constraints):,} matched pairs of visits, {found.n_contradicted:,} contradict the others"
    for words, number in sorted(found.refused.items()):
        matches += f"; of {number:,} more {words}"
    print_rows([
        ("passes", f"{len(found.passes)}, told apart by {found.passes.by}"),
        ("matches", matches),
        ("corrections", f"a motion of each pass{f', and drift of {drift:g} m' if drift else ', rigid'}"),
    ])  # fmt: skip
    _print_pairs(found)
    in_crs = math.hypot(found.sigma_of_map, found.sigma_of_datum)
    before_and_after = f"{found.sigma_before:.4f} m before, {found.sigma_of_pass:.4f} m after"
    print_rows([
        ("sigma", f"one pass beside the others {before_and_after}; a map of all of them {found.sigma_of_map:.4f} m:"
         " `map build` finds it in alignment.json"),
        ("datum", f"the mean of the passes' georeference, known to {found.sigma_of_datum:.3f} m: where answers have to"
         f" hold in the CRS, --sigma {in_crs:.3f}"),
        *(("note", each.words) for each in found.connectivity if each.words),
    ])  # fmt: skip


def _print_pairs(found: Alignment) -> None:
    """Distances between passes, pair by pair."""
    typer.echo(f"{'passes':<12} {'pairs':>5}  {'horizontal, median / 95 % m':>35}  {'height, median m':>18}")
    for pair in found.pairs[:MOST_PAIRS]:
        first, second = (number + 1 for number in pair.passes)
        (before, before_95), (after, after_95) = pair.horizontal_before, pair.horizontal_after
        horizontal = f"{before:>7.3f} / {before_95:.3f} -> {after:>7.4f} / {after_95:.4f}"
        height = f"{pair.height_before[0]:>7.3f} -> {pair.height_after[0]:>7.4f}"
        typer.echo(f"{f'{first} - {second}':<12} {pair.n_constraints:>5}  {horizontal}  {height}")
    if len(found.pairs) > MOST_PAIRS:
        typer.echo(f"{'':<12} {len(found.pairs) - MOST_PAIRS} more pairs in residuals.csv")
