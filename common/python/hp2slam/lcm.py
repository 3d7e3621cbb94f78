"""LCM over UDP multicast in plain Python, for drivers and listeners; and scans to HP2-SLAM.

Debian 12 has no Python binding of LCM, so this module carries what is needed: publish, subscribe, handle. Its calls are those of
LCM's own binding (pip install lcm), which can be used in its place. The message types are in the package hp2 (hp2.scan_t, ...).

    from hp2 import odometry_t
    from hp2slam.lcm import LCM, publish_scan
    bus = LCM()
    bus.subscribe("HP2_ODOMETRY", lambda channel, data: print(odometry_t.decode(data).odom_from_sensor.translation))
    publish_scan(bus, points, stamp_s=t, duration_s=0.1, time=times, sequence=n)
    bus.handle_timeout(10)
"""
import os
import random
import re
import select
import socket
import struct
import time as clock
import zlib

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
_SHORT, _LONG = 0x4C433032, 0x4C433033
_MOST = 65499  # bytes of channel and data in one datagram
_PIECE = 60000  # bytes of a scan in one chunk_t
_OPEN_LIMIT = 64  # messages whose fragments are awaited


class LCM:
    """The LCM network of a URL udpm://GROUP:PORT?ttl=N. Default: the environment's LCM_DEFAULT_URL, else this machine alone."""

    def __init__(self, url=None):
        url = url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL
        match = re.fullmatch(r"udpm://([\d.]*)(?::(\d+))?(?:\?(.*))?", url)
        if not match:
            raise ValueError(f"{url} is no LCM URL of the form udpm://239.255.76.67:7667?ttl=0")
        options = dict(part.split("=", 1) for part in (match.group(3) or "").split("&") if "=" in part)
        self._group = (match.group(1) or "239.255.76.67", int(match.group(2) or 7667))
        self._subscriptions, self._open, self._number = [], {}, 0
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(options.get("ttl", 0)))
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, int(options.get("recv_buf_size", 4 << 20)))
        self._in.bind(self._group)
        member = struct.pack("4s4s", socket.inet_aton(self._group[0]), socket.inet_aton("0.0.0.0"))
        try:
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            raise OSError(f"multicast does not work here ({error}). As root: ip link set lo multicast on; "
                          "ip route add 224.0.0.0/4 dev lo") from error

    def fileno(self):
        """Readable when a message waits."""
        return self._in.fileno()

    def publish(self, channel, data):
        """Sends bytes, or a message with encode()."""
        if hasattr(data, "encode"):
            data = data.encode()
        name = channel.encode() + b"\0"
        self._number = (self._number + 1) & 0xFFFFFFFF
        if len(name) + len(data) <= _MOST:
            self._out.sendto(struct.pack(">II", _SHORT, self._number) + name + data, self._group)
            return
        piece = _MOST - 12
        whole = name + data  # the first fragment begins with the channel
        count = -(-len(whole) // piece)
        for i in range(count):
            part = whole[i * piece:(i + 1) * piece]
            offset = max(0, i * piece - len(name))
            self._out.sendto(struct.pack(">IIIIHH", _LONG, self._number, len(data), offset, i, count) + part, self._group)

    def subscribe(self, channel, handler):
        """Calls handler(channel, data) for messages on channels that match the regular expression."""
        self._subscriptions.append((re.compile(channel), handler))
        return self._subscriptions[-1]

    def unsubscribe(self, subscription):
        """Ends what subscribe() began."""
        self._subscriptions.remove(subscription)

    def handle(self):
        """Waits for one message and handles it."""
        while not self.handle_timeout(1000):
            pass

    def handle_timeout(self, milliseconds):
        """Handles the next message, waiting no longer than this. Returns 1 if there was one, else 0."""
        end = clock.monotonic() + milliseconds / 1e3
        while True:
            ready, _, _ = select.select([self._in], [], [], max(0.0, end - clock.monotonic()))
            if not ready:
                return 0
            datagram, sender = self._in.recvfrom(65536)
            message = self._message(datagram, sender)
            if message:
                for pattern, handler in list(self._subscriptions):
                    if pattern.fullmatch(message[0]):
                        handler(*message)
                return 1

    def _message(self, datagram, sender):
        """(channel, data) if the datagram completes a message."""
        if len(datagram) < 8:
            return None
        magic, number = struct.unpack_from(">II", datagram)
        if magic == _SHORT:
            name, found, data = datagram[8:].partition(b"\0")
            return (name.decode(errors="replace"), data) if found else None
        if magic != _LONG or len(datagram) < 20:
            return None
        size, offset, index, count = struct.unpack_from(">IIHH", datagram, 8)
        if not 0 < count or index >= count or size > 1 << 30:
            return None
        part, name = datagram[20:], None
        if index == 0:
            name, found, part = part.partition(b"\0")
            if not found:
                return None
        if offset + len(part) > size:
            return None
        key = (sender, number)
        if key not in self._open:
            while len(self._open) >= _OPEN_LIMIT:
                del self._open[next(iter(self._open))]
            self._open[key] = {"parts": {}, "name": None, "count": count, "size": size}
        message = self._open[key]
        message["parts"][index] = (offset, part)
        message["name"] = name if name is not None else message["name"]
        if len(message["parts"]) < message["count"] or message["name"] is None:
            return None
        del self._open[key]
        data = bytearray(message["size"])
        for begin, piece in message["parts"].values():
            data[begin:begin + len(piece)] = piece
        return message["name"].decode(errors="replace"), bytes(data[:message["size"]])


def publish_scan(bus, points, stamp_s, duration_s, sequence, time=None, intensity=None, sensor="python"):
    """Sends a scan to the front-end, as a sensor's driver does: whole, or in pieces if it is large.

    points: n rows of x, y, z [m], sensor frame, not deskewed. stamp_s: start of the sweep. duration_s: its length; 0: deskewed.
    sequence: number of the scan, from 0, rising by 1. time: time in the sweep of each point, 0..1.
    """
    import numpy as np
    from hp2 import chunk_t, scan_t
    points = np.asarray(points, np.float32)
    if points.ndim != 2 or points.shape[1] < 3:
        raise ValueError("points are not an array of n rows and at least 3 columns: give x, y, z [m] per row")
    for name, values in (("time", time), ("intensity", intensity)):
        if values is not None and len(values) != len(points):
            raise ValueError(f"{name} has {len(values)} numbers for {len(points)} points")
    scan = scan_t()
    scan.utime, scan.duration = round(stamp_s * 1e6), round(duration_s * 1e6)
    scan.sensor, scan.sequence, scan.session_id = sensor, sequence, 0
    scan.n = len(points)
    scan.x, scan.y, scan.z = (points[:, i].tolist() for i in range(3))
    scan.time = [] if time is None else np.asarray(time, np.float32).tolist()
    scan.intensity = [] if intensity is None else np.asarray(intensity, np.float32).tolist()
    scan.n_time, scan.n_intensity = len(scan.time), len(scan.intensity)
    data = scan.encode()
    if len(data) <= _PIECE:
        bus.publish("HP2_SCAN", data)
        return
    chunk = chunk_t()
    chunk.session_id, chunk.message_id, chunk.total_size = 0, sequence, len(data)
    if not hasattr(bus, "_hp2_sender"):
        bus._hp2_sender = random.getrandbits(62) + 1
    chunk.sender_id = bus._hp2_sender
    chunk.count = -(-len(data) // _PIECE)
    crc = zlib.crc32(data)
    chunk.crc32 = crc - (1 << 32) if crc >= 1 << 31 else crc
    for chunk.index in range(chunk.count):
        chunk.offset = chunk.index * _PIECE
        chunk.data = data[chunk.offset:chunk.offset + _PIECE]
        chunk.size = len(chunk.data)
        bus.publish("HP2_CHUNK_SCAN", chunk.encode())
        clock.sleep(3e-4)  # the receiver's buffer holds two pieces
