"""Four processes on a synthetic drive: a pose for every scan, the same bits from run to run, whoever starts first."""
from harness import *

DATA = "synthetic:tiny"
SCANS = 40


def test():
    with Run() as first, Run() as second, Run() as third:
        first.all_four(DATA)
        check_complete(first, SCANS)
        first.check_session()
        for name in ["poses_kitti.txt", "poses_odometry_kitti.txt", "map.ply", "map.pcd", "trajectory.png",
                     "map_topdown.png", "summary.json"]:
            expect((first.out / name).stat().st_size > 0, f"{name} is missing or empty")

        # The player long before the others, the viewer last; one thread instead of two.
        second.player(DATA)
        second.wait_for_log("player", "waiting for a back-end", 20)
        second.start("frontend", "--threads", 1)
        second.wait_for_log("frontend", "waiting for a back-end", 20)
        second.backend()
        second.wait_for_log("backend", "the session is complete", 120)
        second.viewer()
        second.wait(60)
        check_complete(second, SCANS)
        expect(same_poses(first, second), "the poses differ with another order of starting and one thread")

        # The player after everything else has been waiting for it.
        third.backend()
        third.viewer()
        third.frontend()
        third.wait_for_log("frontend", "waiting for scans", 20)
        third.player(DATA)
        third.wait(120)
        expect(same_poses(first, third), "the poses differ when the player starts last")

        # A viewer that has written everything before the back-end's next STATUS: the back-end hears of it all the same.
        for phase in range(3):
            first.backend()
            first.wait_for_log("backend", "the session is complete", 20)
            time.sleep(2.1 + 0.15 * phase)
            first.viewer()
            first.wait(20, "viewer_headless", "backend")

        # Odometry on the bus without a back-end.
        with Run() as alone:
            alone.frontend("--standalone")
            alone.player(DATA)
            alone.wait(60)
            expect("40 of 40 scans" in alone.log("player"), "a standalone front-end did not register all scans")

        # Offline, from the stored session.
        again = first.folder / "again"
        subprocess.run([BIN / "hp2_viewer_headless", "--session", first.session, "--out", again], check=True,
                       stdout=subprocess.DEVNULL)
        expect((again / "poses_tum.txt").read_bytes() == (first.out / "poses_tum.txt").read_bytes(),
               "the poses written offline differ from those written live")
        summary = first.summary()
        print({k: summary[k] for k in summary if not isinstance(summary[k], (dict, list))})


main(test)
