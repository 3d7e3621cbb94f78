"""A second front-end on a session is refused with a message, a second viewer is welcome; pause, step and resume; one
command to all ends the session with everything stored."""
from harness import *

DATA = "synthetic:tiny"
SCANS = 40


def control(run, *words):
    subprocess.run([BIN / "hp2_control", *map(str, words), "--lcm-url", run.url], check=True)


def stop_all():
    """The back-end hears the command before it has the last submap."""
    with Run() as run:
        odometry = Odometry()
        backend = run.start("backend", "--session", run.session)  # would stay for viewers
        run.viewer("--keep-running")
        run.frontend()
        run.player("synthetic:block", "--rate", 4)
        odometry.wait_for(100, 60)
        backend.send_signal(signal.SIGSTOP)
        run.start("control", "stop")
        run.wait_for_log("frontend", "cutting the last submap", 10)
        time.sleep(1.0)
        backend.send_signal(signal.SIGCONT)
        run.wait(60)
        poses = len(run.poses())
        print(f"stopped by one command at scan {odometry.sequence}: {poses} poses")
        scans = len(odometry.scans)
        expect(scans <= poses < 444, f"{poses} poses for {scans} registered scans")
        run.check_session()
        with sqlite3.connect(run.session / "session.sqlite") as db:
            expect(db.execute("select ended from graph").fetchall() == [(1,)], "the session has not been ended")


def stop_before_the_first_scan():
    with Run() as run:
        run.backend()
        run.viewer()
        run.frontend()
        run.player(DATA, "--start-paused")
        run.wait_for_log("player", "paused", 20)
        control(run, "stop")
        viewer = run.processes.pop("viewer_headless")
        run.wait(30)
        expect(viewer.wait(30) == 1, "a session without a pose is no success")


def two_at_once():
    """Which of two front-ends that begin at the same moment stays is for them to find out."""
    with Run() as run:
        run.backend()
        run.viewer()
        pair = [run.start(name, "--lcm-url", run.url, program="hp2_frontend") for name in ("one", "two")]
        patience = Patience(20)
        while all(p.poll() is None for p in pair):
            expect(patience.lasts(), "both front-ends stay")
            time.sleep(0.05)
        time.sleep(2.0)
        expect(sorted(str(p.poll()) for p in pair) == ["1", "None"], "not exactly one front-end has left")
        run.processes.pop("one" if pair[0].poll() == 1 else "two")
        run.player(DATA)
        run.wait(60)
        check_complete(run, SCANS)


def test():
    stop_all()
    stop_before_the_first_scan()
    two_at_once()
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
        expect(twin.wait(20 * SLOWER) == 1, f"the second front-end ended with status {twin.returncode}")
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
        expect(second.wait(30 * SLOWER) == 0, "the second viewer failed")
        check_complete(run, SCANS)
        expect(same_poses(plain, run), "the poses differ")
        expect((run.folder / "out2" / "poses_tum.txt").read_bytes() == (run.out / "poses_tum.txt").read_bytes(),
               "the second viewer's poses differ")
        expect(len(odometry.senders) == 1, "odometry came from two front-ends")


main(test)
