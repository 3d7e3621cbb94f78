"""Strangers on the network. Messages that cannot be true end, starve and hang nothing. Two runs on one URL at the same
instant do not mix. A back-end that goes before the front-end has begun keeps nobody. A process that waits says for whom,
and ends."""
from harness import *

DATA = "synthetic:block"


def strange_messages():
    with Run() as plain, Run() as run:
        plain.all_four(DATA, "--count", 120)
        run.backend()
        run.viewer()
        run.frontend()
        # By the clock, so that it is still on its way when the last of them has been said; slow enough to lose nothing.
        run.player(DATA, "--count", 120, "--start-paused")
        run.wait_for_log("player", "paused", 30)
        subprocess.run([BIN / "hp2_control", "step", "10", "--lcm-url", run.url], check=True)
        stranger = run.start("foreign", run.url, program="hp2_foreign")
        run.wait_for_log("foreign", "all said", 60)
        expect(stranger.wait(10) == 0, "the stranger failed")
        for name in ("backend", "viewer_headless", "frontend", "player"):
            expect(run.processes[name].poll() is None, f"{name} has ended")
        subprocess.run([BIN / "hp2_control", "resume", "--lcm-url", run.url], check=True)
        time.sleep(0.2)
        run.start("foreign2", run.url, program="hp2_foreign")
        run.wait(120, "player", "frontend", "backend", "viewer_headless")
        run.processes.pop("foreign2").kill()
        check_complete(run, 120)
        expect(same_poses(plain, run), "the poses differ")


def two_runs_at_once():
    with Run() as run:
        scripts = [subprocess.Popen([SCRIPTS / "run_slam.sh", DATA, "--count", "60", "--out", run.folder / name,
                                     "--lcm-url", run.url, "--build", BIN.parent],
                                    stdout=open(run.folder / f"{name}.txt", "w"), stderr=subprocess.STDOUT)
                   for name in ("one", "two")]
        for name, script in zip(("one", "two"), scripts):
            status = script.wait(240 * SLOWER)
            text = (run.folder / f"{name}.txt").read_text()
            expect(status == 0, f"run {name} ended with status {status}:\n{text[-2000:]}")
        poses = [(run.folder / name / "poses_tum.txt").read_bytes() for name in ("one", "two")]
        expect(poses[0] == poses[1], "the two runs' poses differ")


def backend_gone():
    with Run() as run:
        first = run.start("first", "--session", run.folder / "first", "--lcm-url", run.url, program="hp2_backend")
        run.viewer()
        run.player("synthetic:tiny")
        run.wait_for_log("player", "session ", 20)
        run.wait_for_log("viewer_headless", "session ", 20)
        first.kill()
        first.wait()
        run.processes.pop("first")
        run.backend()
        run.frontend()
        run.wait(60, "player", "frontend", "backend", "viewer_headless")
        check_complete(run, 40)


def nobody_comes():
    with Run() as run:
        for name, arguments, whom in (("frontend", [], "hp2_backend"), ("player", ["synthetic:tiny"], "front-end"),
                                      ("viewer_headless", ["--out", run.out], "hp2_backend"),
                                      ("backend", ["--session", run.session], "hp2_frontend")):
            alone = run.start(name, *arguments, "--give-up-after", 2)
            expect(alone.wait(30 * SLOWER) == 1, f"{name} ended with status {alone.returncode}")
            expect("nothing has happened for 2 s" in run.log(name), f"{name} does not say why")
            expect(whom in run.log(name).split("nothing has happened")[-1], f"{name} does not say for whom")
            run.processes.pop(name)


def test():
    nobody_comes()
    backend_gone()
    strange_messages()
    two_runs_at_once()


main(test)
