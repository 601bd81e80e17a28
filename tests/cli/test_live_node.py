"""`maxcon live` in a process of its own: a drive is played to it over the loopback; it is killed, and starts again."""

import math
import os
import runpy
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace as Record

import numpy as np
import pytest

import written_maps
from maxcon import LiveLocalizer, Pose
from maxcon.cli.options import Outputs, Topics
from maxcon.io.recordings.recording import cloud_content, header_of, position_and_turn
from towns import Town

pytest.importorskip("cyclonedds")
from maxcon.cli.ros2_node import CLOUD, DIAGNOSTICS, ODOMETRY, POSE, TRANSFORMS, Ros2Node
from maxcon.io.ros2_wire import Ros2Wire

EXAMPLES = Path(__file__).parents[2] / "examples"
DOMAIN = 101 + os.getpid() % 100
NOUGHT = np.zeros(36)
STEP = Pose(0.3, 0.0, 0.0, 0.0, 0.0, 0.0)


class Player:
    """Publishes a drive through a town, and keeps what the node publishes."""

    def __init__(self, town):
        self.town, self.pose, self.odometry = town, town.pose(-12.0, 12.0, 0.4), Pose(5.0, 6.0, 0.0, 0.0, 0.0, 1.0)
        self.wire = Ros2Wire(DOMAIN)
        self.truth, self.got = {}, {kind: [] for kind in (POSE, TRANSFORMS, DIAGNOSTICS, CLOUD)}
        topics = ("/maxcon/pose", "/tf", "/diagnostics", "/maxcon/map")
        for topic, (kind, got) in zip(topics, self.got.items(), strict=True):
            self.wire.subscribe(topic, kind, got.append, is_latched=kind == CLOUD)
        self.scans, self.poses = self.wire.publisher("/points", CLOUD), self.wire.publisher("/odom", ODOMETRY)

    def play(self, is_enough, seconds=60.0):
        """Drive on, a scan in 0.1 s, until something is true."""
        end = time.monotonic() + seconds
        while not is_enough() and time.monotonic() < end:
            at, began = time.time(), time.monotonic()
            self.pose, self.odometry = self.pose @ STEP, self.odometry @ STEP
            self.truth[round(at, 3)] = self.pose
            pose = position_and_turn(self.odometry, ("position", "orientation"))
            twist = dict.fromkeys(("linear", "angular"), dict.fromkeys("xyz", 0.0))
            parts = {"pose": {"pose": pose, "covariance": NOUGHT}, "twist": {"twist": twist, "covariance": NOUGHT}}
            self.poses({"header": header_of(at, "odom"), "child_frame_id": "base", **parts})
            points = self.town.scan(self.pose, len(self.truth)).points
            self.scans({"header": header_of(at, "lidar"), **cloud_content(dict(zip("xyz", points.T, strict=True)))})
            while time.monotonic() < began + 0.1:
                self.wire.listen(0.02)
        assert is_enough()


@contextmanager
def running(folder):
    file = folder.with_name("params.yaml")
    file.write_text(f"/maxcon: {{ros__parameters: {{domain: {DOMAIN}, ros2: true, tf_ahead: 0}}}}")
    process = subprocess.Popen([sys.executable, "-m", "maxcon", "live", str(folder), "--params-file", str(file)])
    try:
        yield process
    finally:
        process.kill()
        process.wait(60.0)


def test_a_node_goes_on_behind_odometry_and_tiles_that_hold_nothing(monkeypatch, capsys):
    town, published, given = Town(11), [], [(1e300, 1.0), (1.0, 1e-200), (math.nan, 1.0)]

    def listen(_):
        x, w = given.pop()
        pose = Record(position=Record(x=x, y=0.0, z=0.0), orientation=Record(x=0.0, y=0.0, z=0.0, w=w))
        header = Record(stamp=Record(sec=9, nanosec=0), frame_id="odom")
        node._take_odometry(Record(header=header, pose=Record(pose=pose)))

    wire = Record(publisher=lambda *_, **__: published.append, subscribe=lambda *_, **__: None, listen=listen)
    node = Ros2Node(LiveLocalizer(town.map), wire, Topics(map_folder=None), Outputs())
    with pytest.raises(IndexError):
        node.run()
    assert capsys.readouterr().err.count("Expected ") == 2
    nothing = town.map.tile(min(town.map.tile_keys)).rows(np.arange(0))
    monkeypatch.setattr(town.map, "tile", lambda key: nothing)
    node._publish_thinned_map()
    assert published[-1]["width"] == 0


def test_silence_is_told_once(monkeypatch, capsys):
    monkeypatch.setattr("maxcon.cli.ros2_node.SILENCE", 0.0)
    turns, nothing = iter(range(3)), lambda *_, **__: None
    wire = Record(publisher=nothing, subscribe=nothing, listen=lambda _: next(turns))
    with pytest.raises(StopIteration):
        Ros2Node(LiveLocalizer(Town(11).map), wire, Topics(map_folder=None), Outputs(map_spacing=0.0)).run()
    assert capsys.readouterr().err.count("no scan on /points for 0 s: is it sent there") == 1


@pytest.fixture
def started(maxcon, monkeypatch):
    """Run `maxcon live` up to the node; return what it was given, or how the command ended."""

    def start(*words):
        given = []
        monkeypatch.setattr(
            "maxcon.cli.ros2_node.Ros2Node",
            lambda live, wire, topics, outputs: Record(run=lambda: given.append((live, topics, outputs))),
        )
        monkeypatch.setattr("maxcon.io.ros2_wire.Ros2Wire", lambda domain: None)
        ended = maxcon("live", *words)
        return given[0] if given else ended

    return start


def test_options_stand_in_a_file_of_parameters_as_ros_has_it(started, refused, tmp_path, monkeypatch):
    """Of all sections that mean the node; the environment and what is typed count more."""
    written_maps.write(tmp_path / "town.map", Town(11).map)
    file = tmp_path / "params.yaml"
    file.write_text(
        "other: {ros__parameters: {points: /no}}\n/**:\n  ros__parameters: {use_sim_time: true, queue: 9, points: /a}\n"
        f"maxcon:\n  ros__parameters: {{map: {tmp_path}/town.map, ros2: true, queue: 3, deskew: true, tf_ahead: 0}}\n"
    )
    live, topics, outputs = started("--params-file", file, "--fix", "/typed")
    assert (topics.points, topics.fix, topics.deskew, topics.at_stamp) == ("/a", "/typed", True, False)
    assert (live.options.queue, outputs.tf_ahead, outputs.map_frame) == (3, 0.0, "map")
    for text, words in (
        ("maxcon: {ros__parameters: {delai: 1}}", ["delay, deskew", "got delai"]),
        ("maxcon: {ros__parameters: {queue: [1]}}", ["got queue with a value that is no single one"]),
        ("other: {ros__parameters: {queue: 1}}", ["`maxcon:` with `ros__parameters:`"]),
        ("maxcon: {queue: 1}", ["`maxcon:` with `ros__parameters:`"]), ("maxcon: {a: [", ["to be YAML", "line 1"]),
        ("maxcon: !!python/object:os.system {}", ["to be YAML", "could not determine a constructor"]),
        ("[" * 5000, ["to be YAML"]), (None, ["params.yaml", "no such file"]),
    ):  # fmt: skip
        file.unlink() if text is None else file.write_text(text)
        refused(started("--params-file", file), *words)
    file.write_text("maxcon: {ros__parameters: {queue: 2.7}}")
    ended = started("--params-file", file, tmp_path / "town.map", "--ros2")
    assert ended.code == 2 and "'--queue'" in ended.err


def test_the_launch_file_starts_the_command_with_its_parameters(started, tmp_path, monkeypatch):
    """As far as it can be told without ROS: modules of `launch` that keep what they are given take its place."""
    written_maps.write(tmp_path / "town.map", Town(11).map)

    def kept(name):
        return lambda *what, **how: (name, what, how)

    for module, names in (
        ("launch", ["LaunchDescription"]),
        ("launch.actions", ["DeclareLaunchArgument", "ExecuteProcess"]),
        ("launch.substitutions", ["LaunchConfiguration"]),
    ):
        monkeypatch.setitem(sys.modules, module, Record(**{name: kept(name) for name in names}))
    launched = runpy.run_path(str(EXAMPLES / "live.launch.py"))["generate_launch_description"]()
    *arguments, process = launched[1][0]
    values = {what[0]: how.get("default_value", tmp_path / "town.map") for _, what, how in arguments}
    program, *words = [word if isinstance(word, str) else values[word[1][0]] for word in process[2]["cmd"]]
    _, topics, _ = started(*words[1:])
    assert (program, words[0], topics.points, topics.deskew) == ("maxcon", "live", "/lidar/points", True)


@pytest.mark.kills
def test_a_drive_is_localized_by_a_node_that_is_killed_and_restarted(tmp_path):
    town = Town(11)
    written_maps.write(tmp_path / "town.map", town.map)
    player = Player(town)
    poses, corrections, told, maps = player.got.values()
    with running(tmp_path / "town.map"):
        player.play(lambda: len(poses) >= 10)
    n_before = len(poses)
    assert len(maps) == 1
    with running(tmp_path / "town.map") as node:
        player.play(lambda: len(poses) >= n_before + 5)
        node.terminate()
        assert node.wait(60.0) == 143
    assert len(maps) == 2
    for message in poses:
        place, stamp = message.pose.pose.position, message.header.stamp
        right = player.truth[round(stamp.sec + stamp.nanosec / 1e9, 3)]
        assert math.dist((place.x, place.y, place.z), right.position) < 0.1
        assert message.header.frame_id == "map" and 0.0 < message.pose.covariance[0] < 0.05**2
    (correction,) = corrections[-1].transforms
    assert (correction.header.frame_id, correction.child_frame_id) == ("map", "odom")
    (status,) = told[-1].status
    values = {pair.key: pair.value for pair in status.values}
    assert values["map_origin"] == "458800.000 5429000.000 100.000"
    assert status.message.startswith("localized") and int(values["n_answered"]) >= 5
    assert len(np.frombuffer(maps[0].data, "<f4")) == 3 * maps[0].width > 3000
