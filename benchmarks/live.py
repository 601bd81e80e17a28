# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How soon `maxcon live` answers: a drive is played to it in real time, with messages that are lost, late, or double.

python benchmarks/live.py MAP DATASET [--scans 600] [--restart S] [--disturb 0.02] [--options "--threads 2"]

The DATASET, with odometry and a prior, has 10 scans per second (`maxcon simulate ... --epochs 600 --every 0.1`); it is
played to its end, then backwards, and so on. This process plays, the node is another. Odometry goes out 50 times a
second, a position (of the prior) once a second. A fraction `--disturb` of the scans is lost, as much comes 0.15 to
0.3 s late, and as much twice; of the odometry likewise, but 0.03 s late. `--restart` kills the node after so many
seconds, and starts it again. A latency begins with the stamp (of scans that are sent late: when they are due), and ends
when the pose (of scans without one: the diagnostics) is here again. Of each late answer it is said what it did.
"""

import argparse
import heapq
import itertools
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from header import header

from maxcon import PointMap, Pose
from maxcon.cli.ros2_node import CLOUD, DIAGNOSTICS, FIX, ODOMETRY, POSE
from maxcon.geometry.pose import angles_from_quaternions
from maxcon.io.crs import GeographicFrame
from maxcon.io.recordings.recording import cloud_content, header_of, position_and_turn
from maxcon.io.recordings.transforms import numbers_of
from maxcon.io.ros2_wire import Ros2Wire
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import pose_error

PERIOD, PER_SCAN, FIX_EVERY, SIGMA = 0.1, 5, 10, 2.0
LATE, STARTING = 0.1, 10.0  # s
NO_TWIST = {"twist": dict.fromkeys(("linear", "angular"), dict.fromkeys("xyz", 0.0)), "covariance": np.zeros(36)}


class Node:
    """The node as a process of its own."""

    def __init__(self, map_folder, domain, options):
        self.command = [sys.executable, "-m", "maxcon", "live", map_folder, "--ros2", "--domain", str(domain), *options]
        self.start()

    def start(self):
        """Start it."""
        self.process = subprocess.Popen(self.command, env=os.environ | {"OMP_NUM_THREADS": "1"})

    def end(self):
        """Kill it."""
        self.process.kill()
        self.process.wait()

    @property
    def mebibytes(self):
        """Memory that it holds."""
        lines = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))

    @property
    def seconds(self):
        """Processor time so far."""
        words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


class Player:
    """What is sent, when; and what has come back."""

    def __init__(self, map_folder, dataset, domain):
        point_map = PointMap.open(map_folder)
        self.scans, prior = dataset.open_scans(), read_trajectory(dataset.prior)
        times = self.scans.times.tolist()
        self.reference, self.odometry = read_trajectory(dataset.reference), read_trajectory(dataset.odometry)
        self.first, self.n = times[0], len(times)
        self.truth = [point_map.frame.pose_to_local(self.reference.at(at)) for at in times]
        self.places = GeographicFrame(point_map.frame.crs).to_geographic(prior.positions).tolist()
        self.wire = Ros2Wire(domain)
        self.sent, self.due, self.gone, self.poses, self.told, self.last = {}, {}, {}, {}, {}, {}
        self.wire.subscribe("/maxcon/pose", POSE, self.take_pose)
        self.wire.subscribe("/diagnostics", DIAGNOSTICS, self.take_diagnostics)
        self.to_scans, self.to_odometry = self.wire.publisher("/points", CLOUD), self.wire.publisher("/odom", ODOMETRY)
        self.to_fixes = self.wire.publisher("/fix", FIX)

    def epoch(self, number):
        """Number of the scan that is played so and so many scans after the beginning: to the end and back."""
        turn = number % (2 * self.n - 2)
        return min(turn, 2 * self.n - 2 - turn)

    def cloud(self, number, stamp):
        """Send a scan."""
        points = self.scans.read(self.epoch(number), 0.0, np.inf).points
        self.gone.setdefault(round(1e3 * stamp), time.time())
        self.to_scans({"header": header_of(stamp, "lidar"), **cloud_content(dict(zip("xyz", points.T, strict=True)))})

    def pose(self, number, stamp):
        """Send odometry, so many fifths of scans after the beginning."""
        whole, part = divmod(number, PER_SCAN)
        one, other = self.epoch(whole), self.epoch(whole + 1)
        pose = self.odometry.at(self.first + PERIOD * (one + (other - one) * part / PER_SCAN))
        content = {"pose": position_and_turn(pose, ("position", "orientation")), "covariance": np.zeros(36)}
        self.to_odometry(
            {"header": header_of(stamp, "odom"), "child_frame_id": "lidar", "pose": content, "twist": NO_TWIST}
        )

    def fix(self, number, stamp):
        """Send a position."""
        place = dict(zip(("latitude", "longitude", "altitude"), self.places[self.epoch(number)], strict=True))
        covariance = {"position_covariance": np.diag([SIGMA**2] * 3).ravel(), "position_covariance_type": 2}
        self.to_fixes({"header": header_of(stamp, "gnss"), "status": dict(status=0, service=1), **place, **covariance})

    def take_pose(self, message):
        """Keep a pose, and when it came."""
        now, place, turn = time.time(), message.pose.pose.position, message.pose.pose.orientation
        numbers = numbers_of(place, turn)
        pose = Pose(*numbers[:3], *angles_from_quaternions(numbers[3:]).tolist())
        self.poses.setdefault(stamp_in_ms(message), (now, pose))

    def take_diagnostics(self, message):
        """Keep what is said of a scan, and when it came."""
        (status,) = message.status
        self.last = {pair.key: pair.value for pair in status.values}
        words = "{localizer_ms} ms in the localizer, {processor_ms} of the processor, {n_tiles} tiles loaded, searched"
        words = f"{words} {{half_width}} m around, ".format(**self.last) + status.message
        self.told.setdefault(stamp_in_ms(message), (time.time(), words))

    def events(self, n_scans, start, disturb, rng):
        """When to send what: (time, order, function, number, stamp)."""
        order = itertools.count()
        for number in range(n_scans * PER_SCAN):
            stamp = start + number * PERIOD / PER_SCAN
            kind = rng.random() / disturb if disturb else np.inf
            if kind >= 1.0:
                yield stamp + 0.03 * (kind < 2.0), next(order), self.pose, number, stamp
        for number in range(n_scans):
            stamp = start + number * PERIOD
            kind = rng.random() / disturb if disturb else np.inf
            if kind >= 1.0:
                due = stamp + rng.uniform(0.15, 0.3) * (kind < 2.0)
                yield due, next(order), self.cloud, number, stamp
                self.sent[round(1e3 * stamp)], self.due[round(1e3 * stamp)] = number, due
            if 2.0 <= kind < 3.0:
                yield stamp + 0.02, next(order), self.cloud, number, stamp
            if number % FIX_EVERY == 0:
                yield stamp, next(order), self.fix, number, stamp

    def play(self, events, others):
        """Send what is due and take what comes, to two seconds after the end; call others at their times, s."""
        heapq.heapify(events)
        end = max(events)[0] + 2.0
        while (now := time.time()) < end:
            if others and now >= others[0][0]:
                others.pop(0)[1]()
            if events and events[0][0] <= now:
                _, _, send, number, stamp = heapq.heappop(events)
                send(number, stamp)
            self.wire.listen(max(0.0, min(0.02, (events[0][0] if events else end) - time.time())))


def stamp_in_ms(message):
    return round(1e3 * (message.header.stamp.sec + message.header.stamp.nanosec / 1e9))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map")
    parser.add_argument("dataset")
    parser.add_argument("--scans", type=int, default=600)
    parser.add_argument("--disturb", type=float, default=0.02)
    parser.add_argument("--restart", type=float)
    parser.add_argument("--options", default="")
    options = parser.parse_args()
    header(f"maxcon live {options.options}: {options.scans} scans of {options.dataset}")
    domain = 101 + os.getpid() % 100
    player = Player(options.map, Dataset.open(options.dataset), domain)
    node = Node(options.map, domain, shlex.split(options.options))
    rng, memory = np.random.default_rng(0), []
    while not player.told:  # until it has begun to listen
        player.cloud(0, time.time())
        player.wire.listen(0.5)
    player.told, player.poses = {}, {}
    start, spent = time.time() + 1.0, node.seconds

    def restarted():
        node.end()
        node.start()

    load = os.getloadavg()[0]
    others = [
        (start + at, lambda: memory.append(node.mebibytes)) for at in np.arange(0.0, PERIOD * options.scans, 30.0)
    ]
    starts = [start]
    if options.restart is not None:
        starts.append(start + options.restart)
        others = sorted([*others, (starts[1], restarted)], key=lambda other: other[0])
    player.play(list(player.events(options.scans, start, options.disturb, rng)), others)
    memory.append(node.mebibytes)
    spent = node.seconds - spent * (len(starts) == 1)
    node.end()
    report(player, memory, starts)
    print(f"- processor time since the last start: {spent:.0f} s; load {load:.1f} to {os.getloadavg()[0]:.1f}")


def report(player, memory, starts):
    answered = {stamp: player.poses.get(stamp, told) for stamp, told in player.told.items() if stamp in player.sent}
    latencies = {stamp: 1e3 * (at - player.due[stamp]) for stamp, (at, _) in answered.items()}
    if not latencies:
        raise SystemExit(f"no scan was answered; the last said: {player.last}")
    latency = np.array(list(latencies.values()))
    found = {stamp: pose for stamp, (_, pose) in player.poses.items() if stamp in player.sent}
    errors = [pose_error(pose, player.truth[player.epoch(player.sent[stamp])]) for stamp, pose in found.items()]
    median, almost, worst = np.quantile(latency, [0.5, 0.99, 1.0])
    counts = ", ".join(
        f"{name[2:]} {player.last[name]}" for name in ("n_answered", "n_dropped", "n_late", "n_duplicates")
    )
    late = {stamp for stamp, ms in latencies.items() if ms > 1e3 * LATE}
    n_starting = sum(any(0 <= stamp / 1e3 - start < STARTING for start in starts) for stamp in late)
    print("| sent | answered | localized | right | wrong, localized | ms: median / 99 % / worst | over 100 ms |")
    print("|---|---|---|---|---|---|---|")
    print(
        f"| {len(player.sent)} | {len(answered)} | {len(found)} | {sum(error.is_success for error in errors)}"
        f" | {sum(not error.is_success for error in errors)} | {median:.0f} / {almost:.0f} / {worst:.0f}"
        f" | {len(late)}, {n_starting} at starts |"
    )
    print(f"\n- the node itself counts: {counts}")
    print(f"- MiB, each 30 s and at the end: {', '.join(f'{each:.0f}' for each in memory)}")
    others = [
        words.partition(" m around, ")[2] for stamp, (_, words) in player.told.items() if stamp not in player.poses
    ]
    for words in sorted(set(others))[:12]:
        print(f"- {others.count(words)} x {words}")
    for stamp in sorted(late):
        sent = (
            f"scan {player.sent[stamp]}, sent {1e3 * (player.gone[stamp] - player.due[stamp]):.0f} ms after it was due"
        )
        print(f"- {latencies[stamp]:.0f} ms: {sent}, {player.told[stamp][1]}")
    for start in starts:
        after = min((at for stamp, (at, _) in player.poses.items() if stamp > 1e3 * start), default=np.inf)
        print(f"- {after - start:.1f} s from the start to the first pose")


if __name__ == "__main__":
    main()
