"""A stranger's driver in place of the player: whole scans, scans in pieces, and mid-run in place of a player that died."""
from harness import *


def distance_travelled(run):
    poses = run.poses()
    return poses[-1][1] - poses[0][1]


def inject(run, *arguments):
    return run.start("injector", "--url", run.url, *arguments, program="hp2_injector")


def live_session(scans, *arguments):
    with Run() as run:
        odometry = Odometry()
        run.backend()
        run.viewer()
        run.frontend("--live-backlog", 1000)
        run.wait_for_log("frontend", "waiting for scans", 20)
        injector = inject(run, "--scans", scans, *arguments)
        expect(injector.wait(60 * SLOWER) == 0, "the injector heard no pose")
        odometry.wait_for(scans - 1, 30)
        driven = float(run.log("injector").split(" m driven")[0].split()[-1])
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", run.url], check=True)
        run.wait(60, "frontend", "backend", "viewer_headless")
        check_complete(run, scans)
        moved = distance_travelled(run)
        print(f"{scans} scans {arguments}: moved {moved:.2f} m of {driven:.2f}")
        expect(abs(moved - driven) < 0.3, f"the odometry moved {moved:.2f} m of {driven:.2f}")


def test():
    live_session(60, "--rate", 20, "--points", 3000)
    live_session(60, "--rate", 20, "--points", 20000)
    live_session(40, "--rate", 20, "--points", 20000, "--chunks")

    # The player dies in the middle and an injector takes its place: its scans go on in the same session.
    with Run() as run:
        odometry = Odometry()
        run.backend()
        run.viewer()
        run.frontend("--live-backlog", 1000)
        player = run.player("synthetic:tiny", "--rate", 2 / SLOWER)
        odometry.wait_for(15, 60)
        player.kill()
        player.wait()
        time.sleep(2.0)  # its last offer has grown old
        at = odometry.sequence
        inject(run, "--scans", 30, "--rate", 20, "--points", 6000, "--quiet").wait(60 * SLOWER)
        odometry.wait_for(at + 30, 20)
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", run.url], check=True)
        run.wait(60, "frontend", "backend", "viewer_headless")
        counters = run.summary()["processes"]["hp2_frontend"]["counters"]
        registered, skipped = counters["scans_registered"], counters["scans_skipped"]  # a slow build may skip some of the player's
        expect(registered + skipped == at + 1 + 30, f"{registered} registered + {skipped} skipped of {at + 1} + 30 scans")
        expect(skipped == 0 or SLOWER > 1, f"{skipped} scans were skipped")
        check_complete(run, registered)
        print(f"{at + 1} scans of the player, then 30 of the injector")


main(test)
