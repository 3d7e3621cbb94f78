"""Real time at 10 times the sustainable rate: memory stays, every scan that was played is registered or counted as
skipped."""
from harness import *

SECONDS = int(os.environ.get("HP2_OVERLOAD_SECONDS", "60"))
PLACES = 50


def make_drive(folder, scans):
    """The same 50 places to and fro, by links."""
    (folder / "velodyne").mkdir(parents=True)
    for k in range(PLACES):
        (folder / f"place{k}.bin").write_bytes(room_scan(0.004 * k))
    for i in range(scans):
        k = i % (2 * PLACES - 2)
        os.symlink(folder / f"place{min(k, 2 * PLACES - 2 - k)}.bin", folder / "velodyne" / f"{i:06d}.bin")
    (folder / "times.txt").write_text("".join(f"{0.1 * i:.1f}\n" for i in range(scans)))


def memory_mb(process):
    for line in pathlib.Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


def test():
    with Run() as calm, Run() as run:
        make_drive(calm.folder / "drive", 1000)
        odometry = Odometry()
        calm.backend()
        calm.viewer()
        calm.frontend()
        calm.player(calm.folder / "drive")
        odometry.wait_for(100, 60)
        t0, n0 = time.monotonic(), odometry.sequence
        odometry.wait_for(990, 120)
        sustainable = (odometry.sequence - n0) / (time.monotonic() - t0)
        calm.wait(60)

        rate = 10 * sustainable / 10.0  # the drive was recorded at 10 Hz
        scans = int(10 * rate * SECONDS)
        print(f"sustainable: {sustainable:.0f} scans/s; playing {scans} scans at {rate:.0f} x real time")
        make_drive(run.folder / "drive", scans)
        run.backend()
        run.viewer()
        frontend = run.frontend()
        player = run.player(run.folder / "drive", "--rate", rate)
        run.wait_for_log("frontend", "registering", 60)
        time.sleep(SECONDS / 3)
        early = memory_mb(frontend), memory_mb(player)
        time.sleep(SECONDS / 2)
        late = memory_mb(frontend), memory_mb(player)
        run.wait(SECONDS + 60)
        for name, a, b in zip(("front-end", "player"), early, late):
            print(f"{name}: {a:.0f} MB early, {b:.0f} MB late")
            expect(b < a + 30, f"the {name} grows")
        counters = run.summary()["processes"]["hp2_frontend"]["counters"]
        registered, skipped = counters["scans_registered"], counters["scans_skipped"]
        print(f"{scans} played = {registered} registered + {skipped} skipped")
        expect(registered + skipped == scans, "played is not registered + skipped")
        expect(skipped > scans / 2, "hardly a scan was skipped: this was no overload")
        check_complete(run, registered)


main(test)
