"""The disk is full: a clear message, what was committed stays readable, and the session goes on when there is room. The
session's folder is read-only, its file is damaged: clear messages."""
from harness import *

DATA = "synthetic:block"


def refused(run, *words):
    run.processes.pop("backend", None)
    backend = run.start("refused", "--session", run.session, "--lcm-url", run.url, program="hp2_backend")
    expect(backend.wait(20 * SLOWER) == 1, f"the back-end ended with status {backend.returncode}")
    said = run.log("refused").split("hp2_backend: error: ")[-1].strip()
    print("    " + said)
    for word in words:
        expect(word in said, f'the message does not say "{word}"')
    run.processes.pop("refused")


def cannot_be_opened(run):
    """A read-only folder, then a page in the middle of the file that holds rubbish."""
    subprocess.run(["mount", "-o", "remount,ro", str(run.session)], check=True)
    refused(run, "cannot be written", "permission")
    again = run.folder / "again"
    subprocess.run([BIN / "hp2_viewer_headless", "--session", run.session, "--out", again], check=True,
                   stdout=subprocess.DEVNULL)
    expect((again / "poses_tum.txt").read_bytes() == (run.out / "poses_tum.txt").read_bytes(),
           "the poses read from a read-only session differ")
    subprocess.run(["mount", "-o", "remount,rw", str(run.session)], check=True)
    with open(run.session / "session.sqlite", "r+b") as file:
        size = int.from_bytes(file.read(18)[16:], "big")  # of a page, in SQLite's header
        file.seek(2 * size)
        file.write(os.urandom(size * 5))
    refused(run, "damaged", "session.sqlite", ".recover")


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
            status = backend.wait(120 * SLOWER)
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
            cannot_be_opened(run)
        finally:
            for process in run.processes.values():
                if process.poll() is None:
                    process.kill()
                    process.wait()
            subprocess.run(["umount", "-l", str(run.session)])


main(test)
