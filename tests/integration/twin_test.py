"""A second front-end on a session is refused with a message, a second viewer is welcome; pause, step and resume."""
from harness import *

DATA = "synthetic:tiny"
SCANS = 40


def control(run, *words):
    subprocess.run([BIN / "hp2_control", *map(str, words), "--lcm-url", run.url], check=True)


def test():
    with Run() as plain, Run() as run:
        plain.all_four(DATA)
        odometry = Odometry()
        run.backend()
        run.viewer()
        second = run.start("viewer2", "--out", run.folder / "out2", "--lcm-url", run.url, program="hp2_viewer_headless")
        run.frontend()
        run.player(DATA, "--start-paused")
        run.wait_for_log("player", "paused", 20)

        twin = run.start("twin", "--lcm-url", run.url, program="hp2_frontend")
        expect(twin.wait(20) == 1, f"the second front-end ended with status {twin.returncode}")
        expect("another front-end runs this session already" in run.log("twin"), "the second front-end does not say why")
        expect(run.processes["frontend"].poll() is None, "the first front-end has gone")

        time.sleep(0.5)
        expect(odometry.sequence == -1, "scans were played although the player is paused")
        control(run, "step", 3)
        odometry.wait_for(2, 20)
        time.sleep(0.5)
        expect(odometry.sequence == 2, f"step 3 played up to scan {odometry.sequence}")
        control(run, "resume", "--session", 1)  # another session: ignored
        time.sleep(0.5)
        expect(odometry.sequence == 2, "a command of another session was obeyed")
        control(run, "resume")
        run.wait(60, "player", "frontend", "backend", "viewer_headless")
        expect(second.wait(30) == 0, "the second viewer failed")
        check_complete(run, SCANS)
        expect(same_poses(plain, run), "the poses differ")
        expect((run.folder / "out2" / "poses_tum.txt").read_bytes() == (run.out / "poses_tum.txt").read_bytes(),
               "the second viewer's poses differ")
        expect(len(odometry.senders) == 1, "odometry came from two front-ends")


main(test)
