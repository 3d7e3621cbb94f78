"""The disk is full: a clear message, what was committed stays readable, and the session goes on when there is room."""
from harness import *

DATA = "synthetic:block"


def test():
    with Run() as plain, Run() as run:
        plain.all_four(DATA)
        run.session.mkdir()
        mounted = subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode == 0 and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=1500k", "tmpfs", str(run.session)], capture_output=True).returncode == 0
        if not mounted:
            print("skipped: this user may not mount a small file system")
            sys.exit(SKIPPED)
        try:
            backend = run.backend()
            run.viewer()
            run.frontend()
            run.player(DATA)
            status = backend.wait(120)
            expect(status == 1, f"the back-end ended with status {status} although the disk is full")
            expect("full" in run.log("backend") or "space" in run.log("backend"), "the message does not say why")
            print("    " + run.log("backend").strip().splitlines()[-1])
            run.check_session()
            subprocess.run(["mount", "-o", "remount,size=200m", str(run.session)], check=True)
            run.backend()
            run.wait(120)
            check_complete(run, len(plain.poses()))
            expect(same_poses(plain, run), "the poses differ after the disk was full")
            run.check_session()
        finally:
            for process in run.processes.values():
                if process.poll() is None:
                    process.kill()
                    process.wait()
            subprocess.run(["umount", "-l", str(run.session)])


main(test)
