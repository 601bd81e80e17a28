# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans as data packets of a VLP-16, as the scanner sends them over the network, and captures of such packets."""

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import ArrayError, MissingExtraError, OptionError
from maxcon.io.scans import Scans
from maxcon.lab.simulation.sensing.firing_scanner import BLOCK_TIME, FIRING_TIME, LASER_TIME, FiringScanner

__all__ = ["check_capture_writer", "packets_of_scan", "write_capture"]

PACKET = np.dtype(
    [
        ("blocks", [("flag", "<u2"), ("azimuth", "<u2"), ("echoes", [("range", "<u2"), ("intensity", "u1")], 32)], 12),
        ("time", "<u4"),
        ("mode", "u1"),
        ("model", "u1"),
    ]
)  # fmt: skip
"""1206 bytes: 12 blocks of two firings of 16 lasers each, and microseconds since the full hour."""
FLAG, STRONGEST, VLP_16 = 0xEEFF, 0x37, 0x22
RANGE_UNIT = 0.002
N_BLOCKS, N_PACKETS, BLOCKS_PER_PACKET, PORT = 900, 76, 12, 2368
"""75 packets hold a turn; one more without returns follows, as readers end a turn where azimuths start again."""
HOUR = 3600.0
FIRST_TO_MIDDLE = ((N_BLOCKS - 1) * BLOCK_TIME + FIRING_TIME + 15 * LASER_TIME) / 2.0
"""Time from the first shot of a turn to the middle between first and last shot, s."""
LEAST_GAP = N_PACKETS * BLOCKS_PER_PACKET * BLOCK_TIME
"""Shortest time from one scan to the next, s: that of a turn's packets, the one without returns included."""
LARGEST_ANGLE_OFF = np.radians(0.05)
"""A point farther than this from every ray of the scanner, rad, was not measured by it."""


def packets_of_scan(points: NDArray[np.float64], time: float) -> list[tuple[float, bytes]]:
    """Return the packets of one turn, each with the time when it was sent, s.

    Parameters
    ----------
    points : array, shape (n, 3)
        Returns of a `FiringScanner`, sensor frame, m, in any order.
    time : float
        Of the middle of the turn, s.

    Raises
    ------
    ArrayError
        If a point lies on none of the scanner's rays, or farther than the 131 m that packets can hold.

    Notes
    -----
    Ranges become multiples of 2 mm; readers of packets round azimuths to 0.01 degrees.
    """
    columns, layers, ranges = _shots(points)
    packets = np.zeros(N_PACKETS, dtype=PACKET)
    blocks = packets["blocks"]
    blocks["flag"] = FLAG
    blocks["azimuth"] = (40 * (np.arange(blocks.size) % N_BLOCKS)).reshape(blocks.shape)
    echoes = np.zeros((2 * blocks.size, 16), dtype=np.uint16)
    echoes[columns, FiringScanner().order[layers]] = ranges
    blocks["echoes"]["range"] = echoes.reshape(*blocks.shape, 32)
    blocks["echoes"]["intensity"] = np.where(echoes > 0, 100, 0).reshape(*blocks.shape, 32)
    times = time - FIRST_TO_MIDDLE + np.arange(len(packets)) * BLOCKS_PER_PACKET * BLOCK_TIME
    packets["time"] = np.round(times % HOUR * 1e6) % (HOUR * 1e6)
    packets["mode"], packets["model"] = STRONGEST, VLP_16
    return [(float(at), packet.tobytes()) for at, packet in zip(times, packets, strict=True)]


def _shots(points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.int64]]:
    """Firing and layer that measured each point, and its range in units of 2 mm, shape (n,) each."""
    scanner = FiringScanner()
    level = np.hypot(points[:, 0], points[:, 1])
    above = points[:, 2, None] - scanner.heights
    off = np.arctan2(above, level[:, None]) - scanner.elevations
    layers = np.abs(off).argmin(axis=1)
    rows = np.arange(len(points))
    clockwise = np.degrees(-np.arctan2(points[:, 1], points[:, 0])) - scanner.lags_deg[layers]
    firings = np.round(clockwise / scanner.azimuth_step_deg).astype(np.int64)
    sideways = np.radians(clockwise - firings * scanner.azimuth_step_deg)
    ranges = np.round(np.hypot(level, above[rows, layers]) / RANGE_UNIT).astype(np.int64)
    wrong = (np.abs(off[rows, layers]) > LARGEST_ANGLE_OFF) | (np.abs(sideways) > LARGEST_ANGLE_OFF)
    wrong |= ranges > np.iinfo(np.uint16).max
    if wrong.any():
        x, y, z = points[wrong.argmax()]
        raise ArrayError(
            f"Expected points on the rays of a VLP-16 and up to 131 m away, to write them as its packets, got {x:.3f},"
            f" {y:.3f}, {z:.3f} m. Simulate with a FiringScanner."
        )
    return firings % scanner.n_columns, layers, ranges


def write_capture(path: str | os.PathLike[str], scans: Scans) -> None:
    """Write scans as a capture of packets, a .pcap: one turn per scan, whose middle is at the time of the scan.

    Parameters
    ----------
    path : path
        File to write.
    scans : Scans
        Of a `FiringScanner`, at least `LEAST_GAP` (100.9 ms) apart.

    Raises
    ------
    MissingExtraError
        If the extra `recordings` is not installed.
    OptionError
        If scans are closer together.
    ArrayError
        If points are not on the rays of a `FiringScanner`.
    FileError
        If the capture cannot be written.
    """
    dpkt = check_capture_writer()
    closest = float(np.diff(scans.times).min(initial=np.inf))
    if closest < LEAST_GAP:
        raise OptionError(
            f"Expected scans at least a turn of {1e3 * LEAST_GAP:.1f} ms apart, to write them as packets, got"
            f" {1e3 * closest:.1f} ms. Simulate fewer epochs."
        )
    with atomic_file(path) as partial, partial.open("wb") as stream:
        writer = dpkt.pcap.Writer(stream)
        for at, data in _packets(scans):
            writer.writepkt(_frame(dpkt, data), ts=at)


def _packets(scans: Scans) -> Iterator[tuple[float, bytes]]:
    for raw in scans.scans(0.0, np.inf):
        yield from packets_of_scan(raw.points, raw.time)


def _frame(dpkt: Any, data: bytes) -> bytes:
    """The Ethernet frame of a packet: sent from the scanner's default address, as a broadcast."""
    udp = dpkt.udp.UDP(sport=PORT, dport=PORT, ulen=8 + len(data), data=data)
    inside = dpkt.ip.IP(src=b"\xc0\xa8\x01\xc9", dst=b"\xff" * 4, p=dpkt.ip.IP_PROTO_UDP, data=udp, len=28 + len(data))
    return bytes(dpkt.ethernet.Ethernet(src=b"\x60\x76\x88\x00\x00\x00", dst=b"\xff" * 6, data=inside))


def check_capture_writer() -> Any:
    """Return the package that writes captures.

    Raises
    ------
    MissingExtraError
        If the extra `recordings` is not installed.
    """
    try:
        import dpkt
    except ImportError as error:
        raise MissingExtraError(
            "Expected the package dpkt to write a capture of packets, got none installed."
            " pip install 'maxcon[recordings]'"
        ) from error
    return dpkt
