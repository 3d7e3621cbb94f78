#!/usr/bin/env python3
"""Shows what is in a stored session.

usage: session.py DIR       DIR is the output folder of a run, e.g. out/demo
"""
import sys

import numpy as np

import hp2slam

if len(sys.argv) != 2:
    sys.exit(__doc__)
session = hp2slam.open(sys.argv[1])
steps = np.linalg.norm(np.diff(session.poses[:, :3, 3], axis=0), axis=1)
print(f"{len(session.poses)} scans in {len(session)} submaps, {steps.sum():.1f} m")
moved = hp2slam.evaluate(session.poses, session.odometry_poses)["ate"]["rmse"] if len(session.poses) > 2 else 0.0
print(f"closures moved the trajectory by {moved:.3f} m (RMS)")
for closure in session.closures:
    verdict = "accepted" if closure["accepted"] else f"refused: {closure['reason']}"
    print(f"closure {closure['from_submap']} - {closure['to_submap']}: {verdict}")
points = session.points(voxel_m=0.5)
print(f"{len(points)} points of the map, from {points.min(0).round(1)} to {points.max(0).round(1)}")
