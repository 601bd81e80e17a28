# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The moving picture of the README: scans of a simulated drive at rough positions, then at the answers, in the city.

maxcon simulate city
maxcon map build city/map/*.laz --trajectory city/map/trajectory.txt --vehicle-class 64 -o city.map
python benchmarks/drive_picture.py city city.map [-o docs/images/drive.webp] [--epochs 2,8,...] [--seed 0]

Each prior is off by up to 12 m and 10 degrees. One scan is broken: it turned while it was taken and was not deskewed.
"""

import argparse
import math
from pathlib import Path

import laspy
import numpy as np
from drives import DOCS
from faults import not_deskewed
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from maxcon import MaximumConsensus, PointMap, Pose, Scan, open_scans, read_trajectory
from maxcon.geometry import wrap_angle
from maxcon.lab.study.prior_trials import prior_at, prior_level

WIDTH, HEIGHT, FINER = 1000, 400, 2
BACKGROUND, ORANGE, BLUE, INK = (14, 18, 26), (255, 150, 30), (80, 190, 255), (235, 238, 243)
SHADES = {2: (58, 63, 72), 3: (74, 86, 74), 4: (82, 98, 82), 5: (88, 106, 88), 64: (84, 84, 92)}
"""Colours of ground, vegetation and cars of the clouds; all else, houses mostly, is lighter."""
HOUSE = (128, 129, 132)
SLIDE = 7
"""Frames from prior to answer."""


class Camera:
    """A view in perspective, from a place to another, local frame, m."""

    def __init__(self, place, target, width_deg):
        ahead = np.subtract(target, place)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self.place, self.axes = np.asarray(place), np.array([right, np.cross(ahead, right), ahead])
        self.focal = 0.5 * WIDTH / math.tan(math.radians(0.5 * width_deg))

    def pixels(self, points, finer=1):
        """Columns and rows, float, and depths of the points before the camera."""
        x, y, depth = self.axes @ (points - self.place).T
        is_ahead = depth > 1.0
        scale = finer * self.focal / np.where(is_ahead, depth, 1.0)
        column, row = 0.5 * finer * WIDTH + scale * x, 0.5 * finer * HEIGHT + scale * y
        is_seen = is_ahead & (column >= 0) & (column < finer * WIDTH) & (row >= 0) & (row < finer * HEIGHT)
        return column, row, depth, is_seen


def city_picture(camera, clouds, frame):
    """The clouds as the camera sees them: colours by class, dark where something nearer begins beside."""
    height, width = FINER * HEIGHT, FINER * WIDTH
    nearest, colors = np.full(height * width, np.inf), np.tile(np.uint8(BACKGROUND), (height * width, 1))
    for path in clouds:
        cloud = laspy.read(path)
        column, row, depth, is_seen = camera.pixels(frame.to_local(cloud.xyz), FINER)
        palette = np.tile(np.uint8(HOUSE), (256, 1))
        for number, shade in SHADES.items():
            palette[number] = shade
        of_points = palette[np.asarray(cloud.classification)]
        for down, aside in np.ndindex(2, 2):  # a point covers four of the fine pixels
            at = np.minimum(row[is_seen].astype(int) + down, height - 1) * width
            at += np.minimum(column[is_seen].astype(int) + aside, width - 1)
            order = np.argsort(-depth[is_seen], kind="stable")
            at, far = at[order], depth[is_seen][order]
            is_nearer = far < nearest[at]
            nearest[at[is_nearer]], colors[at[is_nearer]] = far[is_nearer], of_points[is_seen][order][is_nearer]
    depths = np.log(np.minimum(nearest, 500.0)).reshape(height, width)
    shade = np.zeros_like(depths)
    for axis, step in ((0, 2), (0, -2), (1, 2), (1, -2)):
        shade += np.clip(depths - np.roll(depths, step, axis), 0.0, 0.02)
    lit = colors.reshape(height, width, 3) * np.exp(-18.0 * shade)[..., None]
    return Image.fromarray(lit.astype(np.uint8)).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


def font(size, weight=""):
    """The font of matplotlib's pictures."""
    return ImageFont.truetype(Path(get_data_path(), "fonts", "ttf", f"DejaVuSans{weight}.ttf"), size)


def between(one, other, ratio):
    """The pose so far on the way from one to another."""
    moved = one.position + ratio * (other.position - one.position)
    turn = ratio * wrap_angle(other.heading - one.heading)
    return Pose(*moved, other.roll, other.pitch, one.heading + turn)


def frame_picture(city, camera, points, poses, words, path):
    """One frame: the city, a scan at poses in their colours, its sensor, where the vehicle has been, words below."""
    pixels = np.array(city)
    for color, pose in poses.items():
        column, row, _, is_seen = camera.pixels(pose.apply(points))
        for down, aside in np.ndindex(2, 2):
            rows = np.minimum(row[is_seen].astype(int) + down, HEIGHT - 1)
            pixels[rows, np.minimum(column[is_seen].astype(int) + aside, WIDTH - 1)] = color
    picture = Image.fromarray(pixels)
    drawing = ImageDraw.Draw(picture, "RGBA")
    dots = [(place, BLUE, 4, BACKGROUND) for place in path]
    for place, color, radius, rim in (*dots, *((pose, color, 8, (255, 255, 255)) for color, pose in poses.items())):
        (x,), (y,), *_ = camera.pixels(np.array([place.position]))
        drawing.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color, outline=rim, width=radius // 4)
    color = list(poses)[-1]
    drawing.rectangle((0, HEIGHT - 44, WIDTH, HEIGHT), fill=(*BACKGROUND, 225))
    drawing.rectangle((0, HEIGHT - 44, 10, HEIGHT), fill=color)
    headline, rest = words
    drawing.text((24, HEIGHT - 22), headline, INK if color == BLUE else ORANGE, font(17, "-Bold"), "lm")
    drawing.text((36 + font(17, "-Bold").getlength(headline), HEIGHT - 22), rest, INK, font(16), "lm")
    return picture


def frames_of(city, camera, point_map, scans, reference, epochs, broken, seed):
    """Pictures and how long each stands, ms; the first, which is seen where nothing moves, has both colours."""
    method, level, path = MaximumConsensus(), prior_level(12.0, 10.0), []
    for epoch in epochs:
        raw = scans.read(epoch, 1.0, 120.0)
        points = raw.points.astype(np.float64)
        if epoch == broken:
            points = not_deskewed(0.0, 20.0)(points, None)
        truth = point_map.frame.pose_to_local(reference.at(raw.time))
        prior = prior_at(truth, level, seed, epoch)
        estimate = method.localize(Scan(points), point_map, prior)
        off, turn = math.dist(prior.position[:2], truth.position[:2]), abs(wrap_angle(prior.heading - truth.heading))
        rough = "Rough position", f"{off:.1f} m and {math.degrees(turn):.0f}° wrong"
        print(f"epoch {epoch}: {rough[1]}; {estimate.status} {estimate.reason}")

        def picture(poses, *words, points=points[::2]):
            return frame_picture(city, camera, points, poses, words, path)

        if not path:
            words = "Where was this scan taken?", "Orange: at its rough position. Blue: at the answer."
            yield picture({ORANGE: prior, BLUE: estimate.pose}, *words), 2500
        if not estimate.is_localized:
            rest = f"{rough[1]}. The scanner turned by 20° a second, and nobody took that out of the scan."
            yield picture({ORANGE: prior}, rough[0], rest), 3000
            words = estimate.reason.rpartition("; ")[2]
            yield picture({ORANGE: prior}, f"Not localized: {estimate.status}.", words[0].upper() + words[1:]), 4000
            continue
        yield picture({ORANGE: prior}, *rough), 1300
        for step in range(1, SLIDE):
            ratio = 0.5 - 0.5 * math.cos(math.pi * step / SLIDE)
            yield picture({ORANGE: between(prior, estimate.pose, ratio)}, *rough), 50
        error = 1e3 * math.dist(estimate.pose.position[:2], truth.position[:2])
        sigma = 1e3 * math.sqrt(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1])
        rest = f"{error:.0f} mm from the truth, its own sigma {sigma:.0f} mm"
        yield picture({BLUE: estimate.pose}, "Localized", rest), 1700
        path.append(estimate.pose)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, metavar="DATASET")
    parser.add_argument("map", type=Path, metavar="MAP")
    parser.add_argument("-o", "--out", type=Path, default=DOCS / "images" / "drive.webp")
    parser.add_argument("--epochs", default="4,11,17,24,30,37")
    parser.add_argument("--broken", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    point_map = PointMap.open(arguments.map)
    scans = open_scans(arguments.dataset / "scans", arguments.dataset / "scans" / "times.txt")
    reference = read_trajectory(arguments.dataset / "reference.txt")
    epochs = [int(word) for word in arguments.epochs.split(",")]
    places = point_map.frame.to_local(reference.positions)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    along = places[-1] - places[0]  # the way across the picture, the bend of it near
    aside = np.array([along[1], -along[0], 0.0]) / np.hypot(*along[:2])
    camera = Camera(middle + 62.0 * aside + [0.0, 0.0, 92.0], middle + 13.0 * aside, 62.0)
    city = city_picture(camera, sorted((arguments.dataset / "map").glob("*.laz")), point_map.frame)
    pictures, durations = zip(
        *frames_of(city, camera, point_map, scans, reference, epochs, arguments.broken, arguments.seed), strict=True
    )
    options = {"save_all": True, "append_images": pictures[1:], "duration": durations, "loop": 0}
    pictures[0].save(arguments.out, quality=62, method=4, minimize_size=True, **options)
    print(f"{arguments.out}: {len(pictures)} frames, {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
