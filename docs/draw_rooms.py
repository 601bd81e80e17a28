# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Draw docs/images/rooms.svg: the floors of the import contract in pyproject.toml, and what stands on each.

python docs/draw_rooms.py
"""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "rooms.svg"
WIDTH, ROW, GAP, PER_CHARACTER = 860, 34, 8, 7.6


def floors() -> list[list[str]]:
    """Names of the packages and modules on each floor, the highest floor first."""
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    return [[name.strip() for name in layer.split(":")] for layer in contract["layers"]]


def room(name: str, x: float, y: float, width: float) -> str:
    """One box: a package is filled and ends with a slash, a module is not."""
    is_package = (ROOT / "src" / "maxcon" / name).is_dir()
    words, fill = (f"{name}/", "#cfe3f5") if is_package else (name, "#ffffff")
    return (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{ROW - GAP}" rx="4" fill="{fill}" stroke="#45627c"/>'
        f'<text x="{x + width / 2:g}" y="{y + 18:g}" text-anchor="middle">{words}</text>'
    )


def picture() -> str:
    """The drawing, as SVG."""
    rows = floors()
    height = len(rows) * ROW + 30
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="DejaVu Sans Mono,'
        ' monospace" font-size="12">',
        f'<rect width="{WIDTH}" height="{height}" fill="#fbfbf8"/>',
        f'<path d="M 24 20 V {height - 28}" stroke="#b04a2f" stroke-width="2"/>',
        f'<path d="M 18 {height - 36} l 6 10 l 6 -10 z" fill="#b04a2f"/>',
        f'<text x="38" y="{height - 8}" fill="#b04a2f" font-size="11">imports run down, never up, never within a'
        " floor</text>",
    ]
    for number, names in enumerate(rows):
        y = 8 + number * ROW
        widths = [PER_CHARACTER * (len(name) + 3) for name in names]
        x = 46 + (WIDTH - 46 - sum(widths) - 12 * (len(names) - 1)) / 2
        for name, width in zip(names, widths, strict=True):
            lines.append(room(name, round(x, 1), y, round(width, 1)))
            x += width + 12
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture())
