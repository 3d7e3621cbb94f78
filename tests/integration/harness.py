"""What the integration tests share: a network namespace of their own, processes, trajectories.

Python 3 standard library only. A test is a script that imports this module, calls enter_namespace() first, and exits
with status 0 (passed), 77 (skipped) or anything else (failed)."""
import array
import contextlib
import json
import math
import os
import pathlib
import random
import shutil
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time

SKIPPED = 77
BIN = pathlib.Path(os.environ.get("HP2_BIN", "build/bin"))
SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "scripts"
SLOWER = float(os.environ.get("HP2_SLOWER", "1"))  # how many times as long everything may take (sanitizers)
URL = "udpm://239.255.76.67:7667?ttl=0"


def enter_namespace(extra=""):
    """Runs this script again in a network namespace where lo has multicast; skips the test if that is not permitted."""
    if os.environ.get("HP2_TEST_NAMESPACE"):
        return
    unshare = ["unshare", "-nm"] if os.geteuid() == 0 else ["unshare", "-rnm"]
    if subprocess.run(unshare + ["true"], capture_output=True).returncode != 0:
        print("skipped: this machine does not permit network namespaces (unshare -n)")
        sys.exit(SKIPPED)
    setup = "ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo; " + extra
    os.environ["HP2_TEST_NAMESPACE"] = "1"
    sys.stdout.flush()
    os.execvp(unshare[0], unshare + ["bash", "-ec", setup + ' exec "$@"', "_", sys.executable, *sys.argv])


class Failure(Exception):
    """A test's expectation that did not hold."""


def expect(condition, message):
    if not condition:
        raise Failure(message)


class Patience:
    """Seconds that count only while this program runs: a machine that was suspended meanwhile is no failure."""

    def __init__(self, seconds):
        self.left = seconds * SLOWER
        self.now = time.monotonic()

    def lasts(self):
        now = time.monotonic()
        self.left -= min(now - self.now, 0.5)
        self.now = now
        return self.left > 0


class Run:
    """A folder, and processes that log into it; all of them are ended at the end."""

    def __init__(self, url=URL, folder=None):
        self.folder = pathlib.Path(folder or tempfile.mkdtemp(prefix="hp2_test_"))
        self.out = self.folder / "out"
        self.session = self.out / "session"
        self.url = url
        self.processes = {}
        self.logs = []
        self.out.mkdir(parents=True, exist_ok=True)

    def __enter__(self):
        return self

    def __exit__(self, kind, value, trace):
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
                process.wait()
        if kind is None and not os.environ.get("HP2_KEEP"):
            shutil.rmtree(self.folder, ignore_errors=True)
        elif kind is not None:
            for log in self.logs:
                print(f"--- {log.name}\n" + log.read_text(errors="replace")[-3000:])

    def start(self, name, *arguments, url=None, program=None, prefix=()):
        """Starts hp2_<name> (or `program`) and returns its Popen."""
        log = self.folder / f"{name}.log"
        if log not in self.logs:
            self.logs.append(log)
        command = [*prefix, str(BIN / (program or f"hp2_{name}")), *map(str, arguments)]
        if program is None:
            command += ["--lcm-url", url or self.url]
        with open(log, "a") as file:
            process = subprocess.Popen(command, stdout=file, stderr=file)
        self.processes[name] = process
        return process

    def backend(self, *arguments, **options):
        return self.start("backend", "--session", self.session, "--exit-when-done", *arguments, **options)

    def viewer(self, *arguments, **options):
        return self.start("viewer_headless", "--out", self.out, *arguments, **options)

    def frontend(self, *arguments, **options):
        return self.start("frontend", "--threads", 2, *arguments, **options)

    def player(self, data, *arguments, **options):
        return self.start("player", data, *arguments, **options)

    def wait(self, seconds, *names):
        """Waits until the named processes (default: all) have ended with status 0."""
        patience = Patience(seconds)
        for name in names or list(self.processes):
            status = None
            while status is None:
                expect(patience.lasts(), f"{name} has not ended after {seconds} s")
                try:
                    status = self.processes[name].wait(0.2)
                except subprocess.TimeoutExpired:
                    pass
            expect(status == 0, f"{name} ended with status {status}")

    def log(self, name):
        path = self.folder / f"{name}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def wait_for_log(self, name, text, seconds):
        patience = Patience(seconds)
        while text not in self.log(name):
            expect(patience.lasts(), f'{name} has not said "{text}" after {seconds} s')
            time.sleep(0.02)

    def poses(self):
        """The final trajectory: list of (time, x, y, z)."""
        lines = (self.out / "poses_tum.txt").read_text().split("\n")
        return [tuple(map(float, line.split()[:4])) for line in lines if line and not line.startswith("#")]

    def summary(self):
        return json.loads((self.out / "summary.json").read_text())

    def check_session(self):
        """integrity_check of the stored session."""
        with contextlib.closing(sqlite3.connect(f"file:{self.session / 'session.sqlite'}?mode=ro", uri=True)) as db:
            expect(db.execute("pragma integrity_check").fetchall() == [("ok",)], "integrity_check of the session failed")

    def all_four(self, data, *player_arguments, seconds=240, frontend_arguments=()):
        """One undisturbed run."""
        self.backend()
        self.viewer("--ground-truth", data)
        self.frontend(*frontend_arguments)
        self.player(data, *player_arguments)
        self.wait(seconds)


class Odometry(threading.Thread):
    """Listens to HP2_ODOMETRY and knows how far the front-end is."""

    def __init__(self, port=7667):
        super().__init__(daemon=True)
        self.sequence = -1
        self.scans = set()  # the first ones of a session are published again
        self.senders = set()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.bind(("", port))
        group = struct.pack("4s4s", socket.inet_aton("239.255.76.67"), socket.inet_aton("0.0.0.0"))
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self.start()

    def run(self):
        while True:
            datagram = self.socket.recv(70000)
            # A short LCM message: "LC02", number, channel, 0, then the encoded odometry_t.
            if datagram[:4] != b"LC02" or not datagram.startswith(b"HP2_ODOMETRY\0", 8):
                continue
            data = datagram[8 + len(b"HP2_ODOMETRY\0"):]
            self.senders.add(struct.unpack_from(">q", data, 24)[0])
            self.sequence = struct.unpack_from(">q", data, 40)[0]
            self.scans.add(self.sequence)

    def wait_for(self, sequence, seconds, alive=None):
        """Waits until this scan is registered, or `alive` is no longer running; returns whether it was."""
        patience = Patience(seconds)
        while self.sequence < sequence:
            if alive is not None and alive.poll() is not None:
                return False
            expect(patience.lasts(), f"scan {sequence} is not registered after {seconds} s (at {self.sequence})")
            time.sleep(0.002)
        return True


def room_scan(offset_m, rings=24, columns=450):
    """A room of 40 x 16 m with a post, seen from `offset_m` along it, as the bytes of a .bin file."""
    values = array.array("f")
    for ring in range(rings):
        slope = math.tan(math.radians(-20 + 36 * ring / rings))
        for k in range(columns):
            angle = 2 * math.pi * (k + 0.37 * ring) / columns
            c, s = math.cos(angle), math.sin(angle)
            reach = min((20 - offset_m) / c if c > 0 else (-20 - offset_m) / c, 8 / abs(s) if s else 1e9)
            reach = min(reach, 1.5 / -slope if slope < 0 else 1e9)
            b, d = c * (3 - offset_m) + s * 2, (3 - offset_m) ** 2 + 4 - 0.09
            if b > 0 and b * b > d:
                reach = min(reach, b - math.sqrt(b * b - d))
            values.extend((reach * c, reach * s, reach * slope, 0.5))
    return values.tobytes()


def ate(run):
    """ATE RMSE [m] as the summary has it."""
    return run.summary()["accuracy"]["final"]["ate"]["rmse"]


def same_poses(a, b):
    """Whether two trajectory files have the same bytes."""
    return (a.out / "poses_tum.txt").read_bytes() == (b.out / "poses_tum.txt").read_bytes()


def check_complete(run, scans):
    """Every scan has exactly one final pose, in order of time."""
    poses = run.poses()
    expect(len(poses) == scans, f"{len(poses)} poses for {scans} scans")
    times = [p[0] for p in poses]
    expect(all(a < b for a, b in zip(times, times[1:])), "times of the poses do not rise: a pose is there twice")
    expect(all(math.isfinite(v) for p in poses for v in p), "a pose is not finite")


def main(test):
    """Runs `test()` and exits as ctest expects."""
    enter_namespace()
    started = time.monotonic()
    try:
        test()
    except Failure as failure:
        print(f"FAILED: {failure}")
        sys.exit(1)
    print(f"passed in {time.monotonic() - started:.1f} s")


__all__ = ["math", "struct", "BIN", "SCRIPTS", "SKIPPED", "SLOWER", "URL", "Failure", "Odometry", "Patience", "Run", "ate", "check_complete", "enter_namespace", "expect", "main",
           "os", "pathlib", "random", "room_scan", "same_poses", "shutil", "signal", "sqlite3", "subprocess", "sys", "time"]
