"""HP2-SLAM in Python: odometry on arrays, stored sessions, evaluation, scans and poses over LCM.

    import hp2slam
    session = hp2slam.open("out/demo")             # poses, points, closures of a stored session
    odometry = hp2slam.Odometry(threads=2)         # scans as arrays in, poses out, no LCM
    hp2slam.evaluate(truth, session.poses)         # ATE, RPE, the KITTI metric
    from hp2slam.lcm import LCM, publish_scan      # a sensor driver in Python

Poses are 4x4 matrices a_from_b: they map coordinates of frame b into frame a. Lengths are metres, times seconds.
"""
import json
import os

import numpy as np

from hp2slam import _core
from hp2slam._core import Error

__all__ = ["Error", "Odometry", "Session", "evaluate", "open"]


class Odometry:
    """The odometry of HP2-SLAM on arrays. The same scans give the same poses, bit for bit, with any number of threads.

    threads: threads of the registration. mode: as frontend.mode. Further keywords are keys of the configuration's section
    "frontend", e.g. max_range_m=40. An unknown key or a value out of range is an Error that names the nearest known one.
    """

    def __init__(self, threads=1, **settings):
        words = {k: str(v).lower() if isinstance(v, bool) else str(v) for k, v in settings.items()}
        self._core = _core.Odometry(threads, words)

    def process(self, points, stamp_s, duration_s=0.0, time=None, sequence=None):
        """Registers one scan. Scans come in order of time.

        points: n rows of x, y, z [m] in the sensor's frame (more columns are ignored), x forward, z up, not deskewed.
        stamp_s: start of the sweep. duration_s: its length; 0 if the points are deskewed already.
        time: time in the sweep of each point, 0..1; without it nothing is deskewed.
        sequence: number of the scan; default: one more than the last.

        Returns a dict:
        - pose: odom_from_sensor at the END of the sweep; stamp_s: that instant; sequence
        - covariance: 6x6, of the motion since the scan before (translation, rotation vector)
        - state: "tracking", "degenerate" or "lost"
        - planar, non_planar, alpha, sigma_m, iterations, ms
        - revised: such dicts of earlier scans whose poses were re-estimated
        """
        return self._core.process(points, stamp_s, duration_s, time, sequence)

    def take_warnings(self):
        """Remarks on the input since the last call, in words."""
        return self._core.take_warnings()


class Session:
    """A stored session, read-only. It may be open in a back-end at the same time: what is stored by now is read.

    folder: the session's folder (with session.sqlite), or the output folder that holds it.
    """

    def __init__(self, folder):
        folder = os.fspath(folder)
        if not os.path.isfile(os.path.join(folder, "session.sqlite")):
            inner = os.path.join(folder, "session")
            if not os.path.isfile(os.path.join(inner, "session.sqlite")):
                raise FileNotFoundError(f"there is no session in {folder}: neither session.sqlite nor session/session.sqlite. "
                                        "Give the output folder of a run.")
            folder = inner
        self._core = _core.Session(folder)

    @property
    def id(self):
        """Random number of the session."""
        return self._core.id

    @property
    def ended(self):
        """True if the session is complete."""
        return self._core.ended

    @property
    def meta(self):
        """Texts stored with the session: data, command, configuration, versions."""
        return self._core.meta

    @property
    def poses(self):
        """map_from_sensor of every scan at the end of its sweep: (n, 4, 4)."""
        return self._core.poses

    @property
    def odometry_poses(self):
        """odom_from_sensor of every scan, before any correction: (n, 4, 4)."""
        return self._core.odometry_poses

    @property
    def stamps_s(self):
        """End of each scan's sweep [s]: (n,)."""
        return self._core.stamps_s

    @property
    def sequences(self):
        """Number of each scan in its stream: (n,)."""
        return self._core.sequences

    @property
    def keyposes(self):
        """map_from_submap: (submaps, 4, 4)."""
        return self._core.keyposes

    @property
    def closures(self):
        """Verdicts on loop candidates, each a dict: from_submap, to_submap, from_from_to (4x4), information (6x6), accepted,
        reason (why not), inliers, overlap, residual_m."""
        return self._core.closures

    def __len__(self):
        """Number of stored submaps."""
        return self._core.submap_count

    def submap_points(self, submap):
        """Points of one submap in the map frame: (n, 3), float32."""
        return self._core.points(submap)

    def points(self, voxel_m=0.0):
        """Points of the whole map: (n, 3), float32. voxel_m: keep one point per voxel of this edge; 0: all."""
        parts = [self.submap_points(i) for i in range(len(self))]
        points = np.concatenate(parts) if parts else np.empty((0, 3), np.float32)
        if voxel_m > 0 and len(points):
            _, first = np.unique(np.floor(points / voxel_m).astype(np.int64), axis=0, return_index=True)
            points = points[np.sort(first)]
        return points


def open(folder):  # noqa: A001  # as gzip.open and its like
    """Opens a stored session: see Session."""
    return Session(folder)


def evaluate(reference, estimate, reference_stamps_s=None, estimate_stamps_s=None, alignment="se3", max_difference_s=0.01):
    """Scores a trajectory: poses (n, 4, 4) or (n, 3, 4), paired by stamps if both are given, else one by one.

    alignment: "se3" (evo_ape -a), "origin" or "none". Returns a dict: ate, rpe_translation, rpe_rotation_deg (each with rmse,
    mean, median, std, min, max, sse, n) and kitti (t_percent, r_deg_per_100m, segments).
    """
    return json.loads(_core.evaluate_json(np.asarray(reference, float), np.asarray(estimate, float), reference_stamps_s,
                                          estimate_stamps_s, alignment, max_difference_s))
