"""Each process is killed (-9) at 5 random moments of a loop and started again: nothing is lost, nothing is doubled."""
from harness import *

DATA = "synthetic:block"


def disturbed(name, scans, seed, truth):
    """One run in which process `name` dies 5 times."""
    rng = random.Random(seed)
    with Run() as run:
        start = {
            "backend": lambda: run.backend(),
            "viewer_headless": lambda: run.viewer("--ground-truth", DATA),
            "frontend": lambda: run.frontend(),
            "player": lambda: run.player(DATA),
        }
        odometry = Odometry()
        for process in start:
            start[process]()
        moments = sorted(rng.sample(range(3, scans - 3), 5))
        kills = 0
        for moment in moments:
            if not odometry.wait_for(moment, 120, alive=run.processes[name]):
                break  # it has ended already: the run was over before this moment
            run.processes[name].kill()
            run.processes[name].wait()
            kills += 1
            run.check_session()
            time.sleep(rng.uniform(0.0, 0.4))
            start[name]()
        run.wait(180)
        expect(kills == 5, f"{name} could be killed only {kills} times")
        check_complete(run, scans)
        run.check_session()
        same = same_poses(run, truth)
        print(f"{name}: killed at scans {moments}, poses {'the same bit for bit' if same else 'DIFFERENT'}, "
              f"ATE {ate(run):.4f} m (undisturbed {ate(truth):.4f} m)")
        expect(same, f"the poses differ after {name} was killed")
        expect(ate(run) <= 1.1 * ate(truth) + 1e-3, "the trajectory is worse")
        accepted = [sum(",true," in line for line in (r.out / "closures.csv").read_text().splitlines())
                    for r in (run, truth)]
        expect(accepted[1] > 0, "the loop is not closed")
        expect(accepted[0] == accepted[1], f"closures accepted: {accepted[0]}, undisturbed {accepted[1]}")


def test():
    with Run() as truth:
        truth.all_four(DATA)
        scans = len(truth.poses())
        check_complete(truth, scans)
        seed = int(os.environ.get("HP2_SEED", time.time_ns() // 1000 % 1000000))
        print(f"random moments of seed {seed} (again: HP2_SEED={seed})")
        for i, name in enumerate(["frontend", "backend", "player", "viewer_headless"]):
            disturbed(name, scans, seed + i, truth)


main(test)
