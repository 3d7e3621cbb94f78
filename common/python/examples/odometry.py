#!/usr/bin/env python3
"""Runs the odometry on the scans of a folder of .bin files (float32 x y z intensity, 10 Hz) and prints the path.

usage: odometry.py FOLDER
"""
import pathlib
import sys

import numpy as np

import hp2slam

if len(sys.argv) != 2:
    sys.exit(__doc__)
odometry = hp2slam.Odometry(threads=2)
for i, file in enumerate(sorted(pathlib.Path(sys.argv[1]).glob("*.bin"))):
    scan = np.fromfile(file, np.float32).reshape(-1, 4)
    result = odometry.process(scan[:, :3], stamp_s=0.1 * i)
    print(i, result["state"], np.round(result["pose"][:3, 3], 3))
