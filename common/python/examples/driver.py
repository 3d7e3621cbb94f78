#!/usr/bin/env python3
"""A sensor driver in Python: publishes the scans of .bin files (float32 x y z intensity) and prints the poses that come back.

usage: driver.py [--url URL] [--rate HZ] FILE.bin ...
Start a back-end, a viewer and a front-end first, e.g. with: hp2-slam live --out out/live
"""
import argparse
import time

import numpy as np
from hp2 import odometry_t

from hp2slam.lcm import LCM, publish_scan

parser = argparse.ArgumentParser(usage=__doc__)
parser.add_argument("files", nargs="+")
parser.add_argument("--url")
parser.add_argument("--rate", type=float, default=10.0)
options = parser.parse_args()

poses = {}


def on_odometry(_, data):
    message = odometry_t.decode(data)
    if message.sequence not in poses:
        print(message.sequence, *(f"{x:.3f}" for x in message.odom_from_sensor.translation), flush=True)
    poses[message.sequence] = message


bus = LCM(options.url)
bus.subscribe("HP2_ODOMETRY", on_odometry)
began = time.time()
for n, file in enumerate(options.files):
    scan = np.fromfile(file, np.float32).reshape(-1, 4)
    publish_scan(bus, scan[:, :3], stamp_s=began + n / options.rate, duration_s=0.0, sequence=n, intensity=scan[:, 3])
    while time.time() < began + (n + 1) / options.rate:
        bus.handle_timeout(1)
while len(poses) < len(options.files) and bus.handle_timeout(5000):  # a slow front-end has some before it
    pass
print(f"{len(poses)} of {len(options.files)} scans have a pose")
