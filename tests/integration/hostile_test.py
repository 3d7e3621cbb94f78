"""Rubbish on every channel while a drive is played: rejected and counted, no process dies or grows, the poses are right."""
from harness import *

DATA = "synthetic:block"
MESSAGES = int(os.environ.get("HP2_HOSTILE_MESSAGES", "500000"))


def memory_mb(process):
    for line in pathlib.Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


def test():
    named = pathlib.Path("/tmp/hp2_frontend")  # as the STATUS messages of hp2_hostile say
    was_there = named.exists()
    with Run() as plain, Run() as run:
        plain.all_four(DATA)
        run.backend()
        run.viewer()
        run.frontend()
        run.player(DATA, "--start-paused")
        run.wait_for_log("player", "paused", 30)
        before = {name: memory_mb(p) for name, p in run.processes.items()}
        run.start("hostile", run.url, MESSAGES, 1, program="hp2_hostile")
        run.wait(300, "hostile")
        for name in ("backend", "viewer_headless", "frontend", "player"):
            expect(run.processes[name].poll() is None, f"{name} has died")
            grown = memory_mb(run.processes[name]) - before[name]
            print(f"{name}: {grown:.0f} MB more")
            expect(grown < 150, f"{name} has grown by {grown:.0f} MB")
        # And while scans are played.
        run.start("hostile2", run.url, MESSAGES, 2, session_id(run), program="hp2_hostile")
        subprocess.run([BIN / "hp2_control", "resume", "--target", "hp2_player", "--session", session_id(run),
                        "--lcm-url", run.url], check=True)
        run.wait(300, "backend", "viewer_headless", "frontend", "player")
        check_complete(run, len(plain.poses()))
        run.check_session()
        expect(same_poses(plain, run), "the poses differ")
        # Messages that name files in other folders: nothing is written outside of --out and the session folder.
        made = sorted(p.name for p in run.folder.iterdir() if p.suffix != ".log")
        expect(made == ["out"], f"files beside the output folder: {made}")
        expect(named.exists() == was_there, "a file is where a STATUS message said")
        print(f"{2 * MESSAGES} messages of rubbish in all")
        rejected = run.summary()["processes"]["hp2_frontend"]["counters"]["rejected"]
        print(f"the front-end rejected {rejected} messages")
        expect(rejected > 1000, "hardly a message was rejected")


def session_id(run):
    line = next(line for line in run.log("backend").splitlines() if " session " in line)
    return line.split(" session ")[1].split()[0]


main(test)
