"""Live producers that begin again, and one that publishes into another run's drive: every scan has a pose or is counted."""
import json

from harness import *


def inject(run, *arguments):
    injector = run.start("injector", "--url", run.url, "--rate", 10, "--points", 3000, "--quiet", *arguments,
                         program="hp2_injector")
    injector.wait(60 * SLOWER)


def counters(run):
    return run.summary()["processes"]["hp2_frontend"]["counters"]


def restarted_driver():
    """The numbers of the second driver begin at 7: neither 0 nor where the first one ended."""
    with Run() as run:
        odometry = Odometry()
        run.backend()
        run.viewer()
        run.frontend("--live-backlog", 1000)
        run.wait_for_log("frontend", "waiting for scans", 20)
        inject(run, "--scans", 30)
        inject(run, "--scans", 30, "--number-from", 7)
        odometry.wait_for(59, 30)
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", run.url], check=True)
        run.wait(60, "frontend", "backend", "viewer_headless")
        check_complete(run, 60)
        expect(run.summary()["scans_in"] == 60, f"{run.summary()['scans_in']} scans in")


def driver_beside_a_player_that_stands_still():
    with Run() as run:
        odometry = Odometry()
        run.backend()
        run.viewer()
        run.frontend()
        player = run.player("synthetic:tiny", "--rate", 1 / SLOWER)
        odometry.wait_for(5, 60)
        player.send_signal(signal.SIGSTOP)
        time.sleep(2.5)  # its last offer has grown old
        inject(run, "--scans", 25)
        player.send_signal(signal.SIGCONT)
        run.wait(120, "player", "frontend", "backend", "viewer_headless")
        found = counters(run)
        expect(found["live_scans_refused"] == 25, f"{found.get('live_scans_refused')} of 25 foreign scans are counted as refused")
        expect(found["scans_registered"] + found["scans_skipped"] == 40, f"{found['scans_registered']} registered")
        warnings = json.dumps(run.summary()["warnings"])
        expect("live scans are refused" in warnings, f"the summary does not tell of the foreign scans: {warnings}")


def test():
    restarted_driver()
    driver_beside_a_player_that_stands_still()


main(test)
