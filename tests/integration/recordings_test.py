"""The same drive in every format gives the same scans bit for bit, and so the same poses; cut off anywhere, the scans before
the cut. The recordings are written by tests/integration/recordings.py and, where it is installed, by npm's @mcap/core."""
from harness import *
import json
import os
import pathlib
import random
import shutil
import subprocess
import tempfile

import recordings as r


def digest(path, *more):
    run = subprocess.run([BIN / "hp2_scan_digest", path, *more], capture_output=True, text=True)
    return run.returncode, run.stdout.splitlines(), run.stderr


def fingerprint():
    """As lcm-gen makes it from the type's own hash, H: (H << 1) + (H >> 63)."""
    h = 0xE969C52E2A059AF2
    return ((h << 1) & (2**64 - 1)) + (h >> 63)


def write_all(folder, scans):
    cdr = [(r.stamp_us(k) + 120_000, r.point_cloud2(k, p)) for k, p in enumerate(scans)]
    big = [(r.stamp_us(k) + 120_000, r.point_cloud2(k, p, ">")) for k, p in enumerate(scans)]
    ros1 = [(r.stamp_us(k) + 120_000, r.point_cloud2(k, p, ros1=True)) for k, p in enumerate(scans)]
    shuffled = cdr[:]
    random.Random(1).shuffle(shuffled)
    paths = {name: folder / name for name in (
        "pcd", "drive.lcm", "plain.bag", "open.bag", "plain.db3", "big.db3", "plain.mcap", "unindexed.mcap", "open.mcap",
        "shuffled.mcap")}
    r.write_pcd(paths["pcd"], scans)
    r.write_lcm_log(paths["drive.lcm"], scans, fingerprint())
    r.write_ros1_bag(paths["plain.bag"], ros1)
    r.write_ros1_bag(paths["open.bag"], ros1, closed=False)
    r.write_db3(paths["plain.db3"], cdr)
    r.write_db3(paths["big.db3"], big)
    r.write_mcap(paths["plain.mcap"], cdr)
    r.write_mcap(paths["unindexed.mcap"], cdr, index=False)
    r.write_mcap(paths["open.mcap"], cdr, closed=False)
    r.write_mcap(paths["shuffled.mcap"], shuffled)
    for kind in ("zstd", "lz4"):
        if r.library(kind) is None:
            continue
        paths[f"{kind}.mcap"] = folder / f"{kind}.mcap"
        r.write_mcap(paths[f"{kind}.mcap"], cdr, kind)
        paths[f"{kind}_unindexed.mcap"] = folder / f"{kind}_unindexed.mcap"
        r.write_mcap(paths[f"{kind}_unindexed.mcap"], shuffled, kind, index=False)
        paths[f"{kind}_messages.db3"] = folder / f"{kind}_messages.db3"
        r.write_db3(paths[f"{kind}_messages.db3"], cdr, kind)
        paths[f"whole.db3.{kind}"] = folder / f"whole.db3.{kind}"
        paths[f"whole.db3.{kind}"].write_bytes(r.compress(kind, paths["plain.db3"].read_bytes()))
    if r.library("lz4"):
        paths["lz4.bag"] = folder / "lz4.bag"
        r.write_ros1_bag(paths["lz4.bag"], ros1, "lz4")
    for name, closed in (("parts", True), ("parts_bare", False)):
        paths[name] = folder / name
        paths[name].mkdir()
        r.write_mcap(paths[name] / "drive_0.mcap", cdr[:5])
        r.write_mcap(paths[name] / "drive_1.mcap", cdr[5:])
        if closed:
            (paths[name] / "metadata.yaml").write_text(
                "rosbag2_bagfile_information:\n  relative_file_paths:\n    - drive_0.mcap\n    - drive_1.mcap\n")
    write_with_npm(folder, scans, paths)
    return paths


def write_with_npm(folder, scans, paths):
    modules = os.environ.get("HP2_NODE_MODULES", "")
    if not modules or shutil.which("node") is None:
        print("not tested: MCAP by npm's @mcap/core (install it and set HP2_NODE_MODULES to its node_modules)")
        return
    points = folder / "points.json"
    points.write_text(json.dumps({"start_us": r.START_US, "step_us": r.STEP_US, "scans": scans}))
    script = pathlib.Path(__file__).with_name("write_mcap.cjs")
    paths["npm.mcap"] = folder / "npm.mcap"
    subprocess.run(["node", script, points, paths["npm.mcap"]], check=True, env=os.environ | {"NODE_PATH": modules})


def check_cuts(path, whole, folder):
    """A file that ends anywhere gives the first of its scans and a warning, or is refused with a reason. In SQLite the
    page that names the messages may lie behind them: what a cut leaves are right scans, not always the first."""
    tree = path.suffix == ".db3"
    data = path.read_bytes()
    most = 0
    for k in range(1, 20):
        cut = folder / ("cut_" + path.name)
        cut.write_bytes(data[:len(data) * k // 20])
        status, lines, errors = digest(cut)
        expect(status == 0 or "error" in errors, f"{path.name} cut off at {k}/20: status {status}, {errors}")
        left = [line for line in whole if line in lines] if tree else whole[:len(lines)]
        expect(lines == left, f"{path.name} cut off at {k}/20 gives other scans")
        expect(status != 0 or errors, f"{path.name} cut off at {k}/20 is taken without a word")
        expect(tree or len(lines) >= most, f"{path.name} cut off at {k}/20 gives fewer scans than cut off before")
        most = len(lines)
    expect(most >= len(whole) - 4, f"{path.name} cut off near its end gives {most} of {len(whole)} scans")


def test():
    scans = r.drive()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        paths = write_all(folder, scans)
        status, expected, errors = digest(paths["plain.bag"])
        expect(status == 0 and len(expected) == len(scans) and not errors, f"plain.bag: {errors}")
        for kind, path in paths.items():
            status, lines, errors = digest(path)
            expect(status == 0, f"{kind}: {errors}")
            expect(lines == expected, f"{kind} gives other scans: {lines[:2]} instead of {expected[:2]}; {errors}")
            expect(kind.startswith("open") == bool(errors), f"{kind}: {errors or 'not closed, and nothing is reported'}")
        print(f"{len(paths)} recordings give the same {len(scans)} scans")
        for kind in ("plain.bag", "plain.db3", "plain.mcap", "zstd.mcap", "open.mcap", "lz4.bag"):
            if kind in paths:
                check_cuts(paths[kind], expected, folder)


main(test)
