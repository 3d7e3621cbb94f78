"""A driver publishes scans of 1 MB at 10 Hz on a machine that is half loaded, with the system's receive buffers: every scan
has a pose or is counted with its reason."""
from harness import *

SECONDS = int(os.environ.get("HP2_LIVE_SECONDS", "30"))
PLACES = 6
BEAMS, COLUMNS = 64, 1024  # with intensity 1 MB per scan
# Why a live scan is left out, as the front-end counts it.
REASONS = ("live_scans_dropped", "live_scans_late", "live_scans_bad_number", "live_scans_refused")


def load(run):
    """Keeps half of the processors busy."""
    for k in range(max(1, os.cpu_count() // 2)):
        process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
        run.processes[f"load {k}"] = process


def to_and_fro(folder, scans):
    places = [folder / f"place{k}.bin" for k in range(PLACES)]
    for k, path in enumerate(places):
        path.write_bytes(room_scan(0.02 * k, BEAMS, COLUMNS))
    return [places[min(i % (2 * PLACES - 2), 2 * PLACES - 2 - i % (2 * PLACES - 2))] for i in range(scans)]


def test():
    scans = int(SECONDS * 10 / SLOWER)
    with Run() as run:
        files = to_and_fro(run.folder, scans)
        run.backend()
        run.viewer()
        run.frontend()
        run.wait_for_log("frontend", "waiting for scans", 20)
        load(run)
        driver = run.start("injector", "--url", run.url, "--rate", 10 / SLOWER, "--quiet", *files, program="hp2_injector")
        expect(driver.wait(10 * SECONDS + 60 * SLOWER) == 0, "the driver failed")
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", run.url], check=True)
        run.wait(120, "frontend", "backend", "viewer_headless")
        summary = run.summary()
        counters = summary["processes"]["hp2_frontend"]["counters"]
        reasons = {name: counters[name] for name in REASONS if counters.get(name)}
        poses, missing = len(run.poses()), scans - len(run.poses())
        print(f"{scans} scans: {poses} poses, {summary['scans_skipped']} skipped, {summary['scans_lost']} lost; {counters}")
        check_complete(run, summary["poses_out"])
        expect(summary["scans_in"] == scans, f"{summary['scans_in']} of {scans} scans are known")
        expect(summary["scans_skipped"] + summary["scans_lost"] == missing, f"{missing} scans have no pose")
        expect(missing == sum(reasons.values()) + counters.get("lost", 0), f"{missing} scans have no pose; counted: {reasons}")


main(test)
