"""What scripts/demo.sh shows: odometry drifts by metres, loop closures bring every scan back to where it was."""
from harness import *


def test():
    demo = (SCRIPTS / "demo.sh").read_text()
    drive = demo.split("drive=")[1].split()[0]
    with Run() as run:
        done = subprocess.run([SCRIPTS / "run_slam.sh", drive, "--out", run.out, "--build", BIN.resolve().parent],
                              capture_output=True, text=True, timeout=600 * SLOWER)
        expect(done.returncode == 0, f"the demo's run failed: {done.stdout[-1000:]}{done.stderr[-1000:]}")
        summary = run.summary()
        odometry, final = (summary["accuracy"][kind]["ate"] for kind in ("odometry", "final"))
        print(f"ATE {odometry['rmse']:.2f} -> {final['rmse']:.3f} m, {summary['elapsed_s']:.0f} s, {summary['states']}")
        expect(odometry["rmse"] > 1.0 and odometry["max"] > 3.0, f"odometry does not drift visibly: {odometry}")
        expect(final["max"] < 0.5, f"the final trajectory lies beside the truth: {final}")
        unsure = summary["states"]["degenerate"] + summary["states"]["lost"]
        expect(unsure <= 0.01 * summary["poses_out"], f"{unsure} scans are degenerate or lost")
        expect(summary["warnings"] == [], f"the demo warns: {summary['warnings']}")


main(test)
