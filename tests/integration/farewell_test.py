"""The end of a session, when the last words are lost: a link that is cut between two processes at that very moment, or a
front-end that is killed and does not come back. Nobody leaves whom another one still needs, and nobody waits for ever."""
from harness import *

DATA = "synthetic:block"
SCANS = 220
A, B = "udpm://239.255.76.67:7667?ttl=0", "udpm://239.255.76.68:7668?ttl=0"
CUT_S = 4.0  # more than it takes to see that an owner is silent


def start_all(run, far=()):
    """All four; those in `far` on the other side of a relay, which is returned."""
    url = {name: B if name in far else A for name in ("backend", "viewer", "frontend", "player")}
    relay = start_relay(run) if far else None
    run.backend(url=url["backend"])
    run.viewer(url=url["viewer"])
    run.frontend(url=url["frontend"])
    run.player(DATA, "--count", SCANS, url=url["player"])
    return relay


def start_relay(run):
    relay = run.start("relay", "239.255.76.67:7667", "239.255.76.68:7668", 0, 0, program="hp2_lossy_relay")
    time.sleep(0.3)
    return relay


def wait_for(run, name, text):
    """As wait_for_log, and quick: what is to be met lasts some tens of milliseconds."""
    patience = Patience(90)
    while text not in run.log(name):
        expect(patience.lasts(), f'{name} has not said "{text}"')
        time.sleep(0.002)


def cut(plain, far, moment, told, needed):
    """The link is cut when each process of `moment` has said its text; unless somebody was `told` before, `needed` stays."""
    with Run() as run:
        relay = start_all(run, far)
        for name, text in moment.items():
            wait_for(run, name, text)
        time.sleep(0.03)
        relay.kill()
        relay.wait()
        time.sleep(CUT_S)
        in_time = not any(text in run.log(name) for name, text in told.items())
        print(f"{' and '.join(far)} cut off " + ("at the end" if in_time else "too late: the end was known"))
        expect(not in_time or run.processes[needed].poll() is None, f"{needed} has left, and others wait for it")
        relay = start_relay(run)
        run.wait(40, "player", "frontend", "backend", "viewer_headless")
        relay.kill()
        relay.wait()
        expect(same_poses(plain, run), "the poses differ")
        return in_time


def frontend_killed(plain, last_submap):
    """Its last submap is stored: nobody needs it any more."""
    with Run() as run:
        start_all(run)
        wait_for(run, "backend", last_submap)
        run.processes["frontend"].kill()
        run.processes.pop("frontend").wait()
        run.wait(40)
        print("front-end killed at the end, player:", run.log("player").strip().splitlines()[-1])
        expect(same_poses(plain, run), "the poses differ")


def test():
    with Run() as plain:
        plain.all_four(DATA, "--count", SCANS)
        submaps = plain.log("backend").count(" info: submap ")
        in_time = [
            # The back-end is closing the last submap's loops.
            cut(plain, ("frontend", "player"), {"frontend": "waiting for the back-end", "backend": f"submap {submaps - 2}: "},
                {"frontend": "the session is complete"}, "backend"),
            cut(plain, ("viewer",), {"viewer_headless": "writing "}, {"backend": "info: finished"}, "backend"),
            cut(plain, ("player",), {"frontend": "cutting the last submap"}, {"player": "every scan is registered"}, "frontend"),
        ]
        expect(any(in_time), "the link was always cut too late: nothing was tested")
        frontend_killed(plain, f"submap {submaps - 1}: ")


main(test)
