"""The back-end stands still for 30 s in lockstep: the front-end goes on, and what it cut meanwhile is delivered."""
from harness import *

DATA = "synthetic:block"
STOPPED_S = 30


def test():
    with Run() as plain, Run() as stalled:
        plain.all_four(DATA)
        scans = len(plain.poses())
        odometry = Odometry()
        backend = stalled.backend()
        stalled.viewer("--ground-truth", DATA)
        stalled.frontend()
        stalled.player(DATA)
        odometry.wait_for(30, 60)
        backend.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        odometry.wait_for(scans - 1, 200)
        print(f"all {scans} scans registered {time.monotonic() - stopped:.1f} s after the back-end was stopped")
        time.sleep(max(0.0, STOPPED_S - (time.monotonic() - stopped)))
        expect(stalled.processes["player"].poll() is None, "the player has ended although nothing was stored")
        backend.send_signal(signal.SIGCONT)
        stalled.wait(120)
        check_complete(stalled, scans)
        stalled.check_session()
        expect(same_poses(plain, stalled), "the poses differ after the back-end stood still")


main(test)
