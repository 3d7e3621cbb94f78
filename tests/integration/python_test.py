"""The Python package hp2slam: odometry on arrays, stored sessions, evaluation, a driver. Skipped where it is not built."""
import importlib.util
import subprocess
import sys

from harness import *

PACKAGE = BIN.parent / "python"
EXAMPLES = SCRIPTS.parent / "common" / "python" / "examples"
sys.path.insert(0, str(PACKAGE))
if importlib.util.find_spec("numpy") is None or not list(PACKAGE.glob("hp2slam/_core*.so")):
    print("skipped: the Python package is not built (-DHP2_WITH_PYTHON=ON), or NumPy is missing")
    sys.exit(SKIPPED)

import numpy as np

import hp2slam
from hp2slam import lcm


def street(x, rays=3000):
    """One scan from x metres along a street: ground, walls on either side, and posts in a row."""
    i = np.arange(rays)
    azimuth, elevation = 2 * np.pi * i / rays * 16, np.radians(-15.3 + 2.0 * (i % 16))
    azimuth += 1e-4
    d = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    hits = [-1.7 / d[:, 2], np.where(d[:, 1] > 0, 12.0, -9.0) / d[:, 1], (80.0 - x) / d[:, 0], (-20.0 - x) / d[:, 0]]
    for k in range(-3, 12):  # walls across, with gaps: what fixes the direction of travel
        t = (6.0 * k - x) / d[:, 0]
        hits.append(np.where((np.abs(t * d[:, 1]) > 6) & (np.abs(t * d[:, 1]) < 9.5) & (t * d[:, 2] < 3), t, np.inf))
    hits = np.array(hits)
    r = np.where(hits > 0.5, hits, np.inf).min(0)
    return (d * r[:, None])[r < 60].astype(np.float32)


def refused(call, *words):
    """Whether the call raises an Error that says all of the words."""
    try:
        call()
    except (hp2slam.Error, ValueError, FileNotFoundError) as error:
        expect(all(w in str(error) for w in words), f"the error does not say {words}: {error}")
        return
    raise Failure(f"no error that says {words}")


def odometry_on_arrays():
    tracks = []
    for threads in (1, 2):
        odometry = hp2slam.Odometry(threads=threads, deskew=False)
        results = [odometry.process(street(0.4 * i), stamp_s=100 + 0.1 * i) for i in range(25)]
        tracks.append(np.array([r["pose"] for r in results]))
    expect(np.array_equal(*tracks), "two threads give other poses than one")
    error = np.linalg.norm(tracks[0][-1][:3, 3] - [0.4 * 24, 0, 0])
    expect(error < 0.1, f"the last pose is off by {error:.3f} m")
    expect(results[-1]["state"] == "tracking" and results[-1]["covariance"].shape == (6, 6), "state or covariance is wrong")
    refused(lambda: hp2slam.Odometry(max_rang_m=40), "max_rang_m", "max_range_m")
    refused(lambda: odometry.process(np.zeros((5, 2)), 0.0), "3 columns")
    refused(lambda: odometry.process(np.zeros((5, 3)), 0.0, 0.1, np.zeros(4)), "one number per point")


def evaluation():
    rng = np.random.default_rng(1)
    truth = np.tile(np.eye(4), (50, 1, 1))
    truth[:, :3, 3] = np.cumsum(rng.normal(size=(50, 3)), 0)
    turn = np.array([[0, -1, 0, 5], [1, 0, 0, 2], [0, 0, 1, 1], [0, 0, 0, 1.0]])
    expect(hp2slam.evaluate(truth, turn @ truth)["ate"]["rmse"] < 1e-9, "a moved trajectory has an error after alignment")
    offset = truth.copy()
    offset[:, 0, 3] += 3
    expect(abs(hp2slam.evaluate(truth, offset, alignment="none")["ate"]["rmse"] - 3) < 1e-9, "an offset of 3 m is not 3 m")
    stamps = np.arange(50.0)
    late = hp2slam.evaluate(truth, truth[10:], stamps, stamps[10:], alignment="none")
    expect(late["ate"]["n"] == 40 and late["ate"]["rmse"] < 1e-12, "poses are not paired by their stamps")
    refused(lambda: hp2slam.evaluate(truth, truth[:, :2]), "4x4")


def stored_session(run):
    subprocess.run([SCRIPTS / "run_slam.sh", "synthetic:tiny", "--out", run.out, "--build", BIN.parent], check=True,
                   capture_output=True)
    session = hp2slam.open(run.out)
    expect(session.ended and len(session.poses) == 40, f"{len(session.poses)} poses of 40 scans")
    files = {"poses_kitti.txt": session.poses, "poses_odometry_kitti.txt": session.odometry_poses}
    for name, poses in files.items():
        written = np.loadtxt(run.out / name).reshape(-1, 3, 4)
        from_first = np.linalg.inv(poses[0]) @ poses  # the odometry's frame begins before the first scan's end
        written = np.concatenate([written, np.tile([[[0, 0, 0, 1.0]]], (len(written), 1, 1))], 1)
        expect(np.allclose(np.linalg.inv(written[0]) @ written, from_first, atol=1e-5), f"poses are not those of {name}")
    expect(np.all(np.diff(session.stamps_s) > 0) and list(session.sequences) == list(range(40)), "stamps or numbers do not rise")
    points = session.points()
    expect(len(points) > 1000 and len(session.points(voxel_m=1.0)) < len(points), f"{len(points)} points of the map")
    submaps = sum(len(session.submap_points(i)) for i in range(len(session)))
    expect(submaps == len(points) and len(session.keyposes) == len(session), "submaps and points do not fit together")
    refused(lambda: hp2slam.open(run.folder / "nothing"), "no session")
    text = subprocess.run([sys.executable, EXAMPLES / "session.py", run.out], check=True, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(PACKAGE)}).stdout
    expect("40 scans" in text, f"the example session.py says:\n{text}")


def fragments():
    """A message of many datagrams comes whole, and twice on its way at once is no problem."""
    a, b, got = lcm.LCM(URL), lcm.LCM(URL), []
    b.subscribe("A.*", lambda channel, data: got.append((channel, data)))
    messages = [("A_SHORT", b"x" * 10), ("A_LONG", bytes(range(256)) * 600), ("OTHER", b"y"), ("A_EDGE", b"z" * 65492)]
    for channel, data in messages:
        a.publish(channel, data)
        while b.handle_timeout(50):
            pass
    expect(got == [m for m in messages if m[0] != "OTHER"], f"{[(c, len(d)) for c, d in got]} came back")
    refused(lambda: lcm.LCM("tcpq://x"), "udpm://")


def driver(run):
    """The example driver: scans of files go out, small and large, and poses come back."""
    scans = run.folder / "scans"
    scans.mkdir()
    for i in range(30):
        points = street(0.02 * i * min(i, 20), 3000 if i % 2 else 20000)
        np.concatenate([points, np.zeros((len(points), 1), np.float32)], 1).tofile(scans / f"{i:03d}.bin")
    run.backend()
    run.viewer()
    run.frontend("--live-backlog", 1000)
    run.wait_for_log("frontend", "waiting for scans", 20)
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
    text = subprocess.run([sys.executable, EXAMPLES / "driver.py", "--url", URL, *sorted(scans.glob("*.bin"))], check=True,
                          capture_output=True, text=True, env=environment).stdout
    expect("30 of 30 scans have a pose" in text, f"the example driver.py says:\n{text}")
    subprocess.run([BIN / "hp2_control", "stop", "--lcm-url", URL], check=True)
    run.wait(60)
    check_complete(run, 30)
    text = subprocess.run([sys.executable, EXAMPLES / "odometry.py", scans], check=True, capture_output=True, text=True,
                          env=environment).stdout
    expect(len(text.splitlines()) == 30, f"the example odometry.py says:\n{text}")


def test():
    odometry_on_arrays()
    evaluation()
    fragments()
    with Run() as run:
        stored_session(run)
    with Run() as run:
        driver(run)


main(test)
