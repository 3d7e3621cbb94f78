"""Writers of one drive in many formats, by their specifications and by Python's own libraries: nothing here shares code
with the readers. Python 3 standard library only; zstd and lz4 through ctypes, where they are installed."""
import ctypes
import ctypes.util
import math
import sqlite3
import struct

START_US = 1_700_000_000_000_000
STEP_US = 100_000


def drive(scans=12, rings=16, columns=90):
    """A LiDAR that moves through a hall with two pillars: per scan a list of (x, y, z, intensity, t [ns])."""
    def cast(ox, oy, dx, dy, dz):
        best = 1e9
        for position, direction, planes in ((ox, dx, (-9.0, 11.0)), (oy, dy, (-6.0, 7.0)), (0.0, dz, (-1.5, 4.0))):
            for plane in planes:
                if abs(direction) > 1e-9 and (plane - position) / direction > 0.1:
                    best = min(best, (plane - position) / direction)
        for cx, cy, radius in ((4.0, 2.0, 0.6), (-3.0, -3.0, 0.8)):
            a, b = dx * dx + dy * dy, (ox - cx) * dx + (oy - cy) * dy
            root = b * b - a * ((ox - cx) ** 2 + (oy - cy) ** 2 - radius * radius)
            if root > 0 and (-b - math.sqrt(root)) / a > 0.1:
                best = min(best, (-b - math.sqrt(root)) / a)
        return best

    result = []
    for scan in range(scans):
        points = []
        for column in range(columns):
            t = column * 100_000_000 // (columns - 1)
            x, y = 0.1 * (scan + t * 1e-8), 0.02 * scan
            azimuth = 2 * math.pi * column / columns
            for ring in range(rings):
                elevation = math.radians(-15 + 30 * ring / (rings - 1))
                d = (math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation))
                r = cast(x, y, *d)
                points.append((r * d[0], r * d[1], r * d[2], float(ring), t))
        result.append(points)
    return result


def stamp_us(scan):
    return START_US + scan * STEP_US


# ---------------------------------------------------------------- messages

FIELDS = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("t", 16, 6))


class Cdr:
    """CDR with its encapsulation header; ROS 1's serialisation if `ros1`."""

    def __init__(self, order="<", ros1=False):
        self.order, self.ros1, self.body = order, ros1, bytearray()

    def add(self, code, value):
        size = struct.calcsize(code)
        if not self.ros1:
            self.body += bytes(-len(self.body) % size)
        self.body += struct.pack(self.order + code, value)

    def text(self, value):
        data = value.encode() + (b"" if self.ros1 else b"\0")
        self.add("I", len(data))
        self.body += data

    def bytes(self):
        return bytes(self.body) if self.ros1 else bytes((0, 1 if self.order == "<" else 0, 0, 0)) + bytes(self.body)


def point_cloud2(scan, points, order="<", ros1=False):
    m = Cdr(order, ros1)
    if ros1:
        m.add("I", scan)
    m.add("I", stamp_us(scan) // 1_000_000)
    m.add("I", stamp_us(scan) % 1_000_000 * 1000)
    m.text("lidar")
    m.add("I", 1)
    m.add("I", len(points))
    m.add("I", len(FIELDS))
    for name, offset, kind in FIELDS:
        m.text(name)
        m.add("I", offset)
        m.add("B", kind)
        m.add("I", 1)
    m.add("B", 0)
    m.add("I", 20)
    m.add("I", 20 * len(points))
    m.add("I", 20 * len(points))
    m.body += b"".join(struct.pack("<4fI", *p) for p in points)
    m.add("B", 1)
    return m.bytes()


# ---------------------------------------------------------------- compression

def library(name):
    found = ctypes.util.find_library(name)
    return ctypes.CDLL(found) if found else None


def compress(kind, data):
    """None if the library is not there."""
    lib = library(kind)
    if lib is None:
        return None
    bound, squeeze = (lib.ZSTD_compressBound, lib.ZSTD_compress) if kind == "zstd" else \
        (lib.LZ4F_compressFrameBound, lib.LZ4F_compressFrame)
    bound.restype = squeeze.restype = ctypes.c_size_t
    size = bound(ctypes.c_size_t(len(data)), *([] if kind == "zstd" else [None]))
    out = ctypes.create_string_buffer(size)
    n = squeeze(out, ctypes.c_size_t(size), data, ctypes.c_size_t(len(data)), ctypes.c_int(3) if kind == "zstd" else None)
    return out.raw[:n]


# ---------------------------------------------------------------- files

def write_pcd(folder, scans):
    folder.mkdir()
    for k, points in enumerate(scans):
        head = ("VERSION 0.7\nFIELDS x y z intensity t\nSIZE 4 4 4 4 4\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n"
                f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n")
        (folder / f"{stamp_us(k)}000.pcd").write_bytes(head.encode() + b"".join(struct.pack("<4fI", *p) for p in points))


def write_lcm_log(path, scans, fingerprint):
    scale = 1.0 / (STEP_US * 1e-6 / 1e-9)
    with open(path, "wb") as log:
        for k, points in enumerate(scans):
            n = len(points)
            column = lambda values: struct.pack(f">{n}f", *values)
            data = struct.pack(">QqqI", fingerprint, stamp_us(k), STEP_US, 1) + b"\0" + struct.pack(">qqi", k, 0, n)
            data += b"".join(column([p[i] for p in points]) for i in range(3))
            data += struct.pack(">i", n) + column([p[3] for p in points])
            data += struct.pack(">i", n) + column([p[4] * scale for p in points])
            channel = b"HP2_SCAN"
            log.write(struct.pack(">IqqII", 0xEDA1DA01, k, stamp_us(k), len(channel), len(data)) + channel + data)


def write_db3(path, messages, kind=""):
    """messages: (recorded [us], bytes)."""
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
                   " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)")
        db.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,"
                   " data BLOB NOT NULL)")
        db.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        db.execute("INSERT INTO topics VALUES (1, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr', '')")
        db.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)",
                       [(t * 1000, compress(kind, m) if kind else m) for t, m in messages])
    db.close()


def mcap_record(code, content):
    return struct.pack("<BQ", code, len(content)) + content


def mcap_text(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<I", len(data)) + data


def write_mcap(path, messages, kind="", chunk=3, index=True, closed=True):
    """messages: (recorded [us], bytes), in any order."""
    magic = b"\x89MCAP0\r\n"
    described = (mcap_record(3, struct.pack("<H", 1) + mcap_text("sensor_msgs/msg/PointCloud2") + mcap_text("ros2msg") +
                             mcap_text("x")) +
                 mcap_record(4, struct.pack("<HH", 1, 1) + mcap_text("/points") + mcap_text("cdr") + mcap_text("")))
    with open(path, "wb") as f:
        f.write(magic + mcap_record(1, mcap_text("ros2") + mcap_text("test")))
        for first in range(0, len(messages), chunk):
            records, entries = described, b""
            for t, m in messages[first:first + chunk]:
                entries += struct.pack("<QQ", t * 1000, len(records))
                records += mcap_record(5, struct.pack("<HIQQ", 1, 0, t * 1000, t * 1000) + m)
            packed = compress(kind, records) if kind else records
            times = [t * 1000 for t, _ in messages[first:first + chunk]]
            f.write(mcap_record(6, struct.pack("<QQQI", min(times), max(times), len(records), 0) + mcap_text(kind) +
                                struct.pack("<Q", len(packed)) + packed))
            if index:
                f.write(mcap_record(7, struct.pack("<H", 1) + mcap_text(entries)))
        if closed:
            f.write(mcap_record(15, bytes(4)))
            at = f.tell()
            f.write((described if index else b"") + mcap_record(2, struct.pack("<QQI", at if index else 0, 0, 0)) + magic)


def bag_record(fields, data):
    head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def write_ros1_bag(path, messages, kind="none", chunk=3, closed=True):
    number = lambda v: struct.pack("<I", v)
    time = lambda us: struct.pack("<II", us // 1_000_000, us % 1_000_000 * 1000)
    connection = bag_record({"op": b"\7", "conn": number(0), "topic": b"/points"},
                            b"".join(struct.pack("<I", len(v)) + v for v in
                                     (b"topic=/points", b"type=sensor_msgs/PointCloud2", b"md5sum=x")))
    header = lambda at, n: bag_record({"op": b"\3", "index_pos": struct.pack("<Q", at), "conn_count": number(1),
                                       "chunk_count": number(n)}, b" " * 4000)
    with open(path, "wb") as f:
        f.write(b"#ROSBAG V2.0\n" + header(0, 0))
        chunks = []
        for first in range(0, len(messages), chunk):
            records, entries = connection if first == 0 else b"", b""
            for t, m in messages[first:first + chunk]:
                entries += time(t) + number(len(records))
                records += bag_record({"op": b"\2", "conn": number(0), "time": time(t)}, m)
            chunks.append((f.tell(), messages[first][0], len(entries) // 12))
            f.write(bag_record({"op": b"\5", "compression": kind.encode(), "size": number(len(records))},
                               compress(kind, records) if kind != "none" else records))
            f.write(bag_record({"op": b"\4", "ver": number(1), "conn": number(0), "count": number(len(entries) // 12)}, entries))
        if closed:
            at = f.tell()
            f.write(connection)
            for position, t, n in chunks:
                f.write(bag_record({"op": b"\6", "ver": number(1), "chunk_pos": struct.pack("<Q", position),
                                    "start_time": time(t), "end_time": time(t), "count": number(1)}, number(0) + number(n)))
            f.seek(13)
            f.write(header(at, len(chunks)))
