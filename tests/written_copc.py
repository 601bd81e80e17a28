"""A COPC file for tests."""

import struct

import laspy
import lazrs
import numpy as np

SIDE = 64.0
"""Of the cube of the octree, m."""


def write_copc(path, points, levels=2, twist=lambda entries: entries):
    """Write points within a cube from (0, 0, 0) as COPC: points of each node of the last level, and none above."""
    n = 2**levels
    keys = np.clip((points / SIDE * n).astype(int), 0, n - 1)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-3)
    octree = struct.pack("<5d2Q2d", SIDE / 2, SIDE / 2, SIDE / 2, SIDE / 2, 1.0, 0, 0, 0.0, 0.0).ljust(160, b"\0")
    laszip = lazrs.LazVlr.new_for_compression(6, 0, True)
    for user, number, data in (("copc", 1, octree), ("laszip encoded", 22204, laszip.record_data())):
        header.vlrs.append(laspy.VLR(user, number, "", data))
    header.set_compressed(True)
    header.partial_reset()
    with path.open("w+b") as stream:
        header.point_count = len(points)
        header.write_to(stream)
        start = stream.tell()
        compressor = lazrs.LasZipCompressor(stream, laszip)
        compressor.reserve_offset_to_chunk_table()
        nodes, ends = np.unique(keys, axis=0).tolist(), []
        for number, key in enumerate(nodes):
            mine = points[(keys == key).all(axis=1)]
            record = laspy.ScaleAwarePointRecord.zeros(len(mine), header=header)
            record.x, record.y, record.z = mine.T
            record["classification"], record["gps_time"] = np.full(len(mine), 6), mine[:, 0]
            compressor.compress_many(np.frombuffer(record.array.tobytes(), np.uint8))
            if number < len(nodes) - 1:  # the last one is finished with the file
                compressor.finish_current_chunk()
                ends.append((stream.tell(), len(mine)))
        compressor.done()
        stream.seek(start)
        ends.append((struct.unpack("<q", stream.read(8))[0], len(mine)))
        entries, at = [], start + 8
        for key, (end, n_of_node) in zip(nodes, ends, strict=True):
            entries.append((levels, *key, at, end - at, n_of_node))
            at = end
        stream.seek(0, 2)
        page = stream.tell() + 60
        entries = twist(entries)
        body = b"".join(struct.pack("<4iQ2i", *entry) for entry in entries)
        stream.write(struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(body), b"") + body)
        stream.seek(375 + 54 + 40)
        stream.write(struct.pack("<2Q", page, len(body)))
        stream.seek(235)
        stream.write(struct.pack("<QI", page - 60, 1))
    return path
