"""scripts/run_slam.sh when something goes wrong: a stage that dies, Ctrl-C, an output folder with a session in it, no
multicast. It says so, ends soon, and loses nothing."""
import hashlib
import json

from harness import *

DATA = "synthetic:block"


class Script:
    """One run of run_slam.sh in the background."""

    def __init__(self, folder, *arguments, environment=None):
        self.out = folder
        self.log = folder.parent / f"{folder.name}.output"
        self.file = open(self.log, "a")
        command = [SCRIPTS / "run_slam.sh", *map(str, arguments), "--out", folder, "--build", BIN.parent]
        self.started = time.monotonic()
        self.process = subprocess.Popen(command, stdout=self.file, stderr=self.file,
                                        env={**os.environ, **(environment or {})})

    def text(self):
        return self.log.read_text(errors="replace")

    def pids(self, name=""):
        """Processes hp2_<name>... that this run has started."""
        found = []
        for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
            try:
                words = stat.read_text().rsplit(") ", 1)
                comm = words[0].split(" (", 1)[1]
                if comm.startswith(f"hp2_{name}"[:15]) and int(words[1].split()[1]) == self.process.pid:
                    found.append(int(stat.parent.name))
            except (OSError, IndexError):
                pass
        return found

    def kill(self, name):
        """Kills a stage as soon as it is there; returns false if the run has ended."""
        while self.process.poll() is None:
            for pid in self.pids(name):
                os.kill(pid, signal.SIGKILL)
                return True
            time.sleep(0.02)
        return False

    def wait_for(self, what, seconds=60):
        """Waits until `what()` is true."""
        patience = Patience(seconds)
        while not what():
            expect(self.process.poll() is None, f"the run has ended early:\n{self.text()}")
            expect(patience.lasts(), f"nothing after {seconds} s:\n{self.text()}")
            time.sleep(0.02)

    def submaps_stored(self):
        log = self.out / "logs" / "backend.log"
        return log.read_text().count(": submap ") if log.exists() else 0

    def end(self, seconds):
        """Waits for the end; returns status and text."""
        since = time.monotonic()
        patience = Patience(seconds)
        while (status := self.process.poll()) is None:
            if not patience.lasts():
                self.process.send_signal(signal.SIGTERM)
                raise Failure(f"not ended after {seconds} s:\n{self.text()}")
            time.sleep(0.02)
        print(f"    [status {status} after {time.monotonic() - since:.1f} s] "
              + "\n      ".join(self.text().replace("\r", "\n").strip().splitlines()[-3:]))
        left = [p for p in self.pids() if p]
        expect(not left, f"processes are left: {left}")
        return status, self.text()


def hashes(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*")
            if p.is_file() and "logs" not in p.parts and not p.name.endswith(("-wal", "-shm"))}


def says(text, *words):
    for word in words:
        expect(word in text, f'the output does not say "{word}":\n{text}')


def poses(out):
    path = out / "poses_tum.txt"
    return [line for line in path.read_text().splitlines() if not line.startswith("#")] if path.exists() else []


def integrity(out):
    with sqlite3.connect(f"file:{out / 'session' / 'session.sqlite'}?mode=ro", uri=True) as db:
        expect(db.execute("pragma integrity_check").fetchall() == [("ok",)], "integrity_check of the session failed")


def help_texts():
    for program in (SCRIPTS / "run_slam.sh", BIN / "hp2_injector"):
        text = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
        says(text, "usage", "--rate")
    says(subprocess.run([SCRIPTS / "run_slam.sh", "--help"], capture_output=True, text=True).stdout, "--topic",
         "--overwrite", "--restart", "Ctrl-C")
    wrong = subprocess.run([BIN / "hp2_injector", "--scans", "many"], capture_output=True, text=True)
    expect(wrong.returncode == 2, "hp2_injector takes --scans many")
    says(wrong.stderr, "many")


def session_there_already(folder):
    print("a complete session in --out")
    out = folder / "tiny"
    expect(Script(out, "synthetic:tiny").end(120)[0] == 0, "the first run failed")
    before = hashes(out)
    for arguments in (["synthetic:tiny"], ["synthetic:block"]):
        status, text = Script(out, *arguments).end(20)
        expect(status == 1, f"status {status}")
        says(text, "complete: 40 scans", "--overwrite", "--out", "Nothing was changed")
    status, text = Script(out, "synthetic:nowhere", "--overwrite").end(20)
    expect(status == 1, "--overwrite of a drive that cannot be played")
    expect(hashes(out) == before, "a refused run has changed something")
    expect(Script(out, "synthetic:tiny", "--count", 25, "--overwrite").end(120)[0] == 0, "--overwrite failed")
    expect(len(poses(out)) == 25, "--overwrite has not begun anew")
    with sqlite3.connect(out / "session" / "session.sqlite") as db:
        db.execute("pragma user_version = 0")
    status, text = Script(out, "synthetic:tiny", "--count", 25).end(20)
    expect(status == 1, f"status {status}")
    says(text, "the session is of version 0, this program writes version", "session.sqlite")


def stage_dies(folder, plain):
    print("the front-end dies; the same command goes on; another drive is refused")
    out = folder / "dies"
    run = Script(out, DATA)
    run.wait_for(lambda: run.submaps_stored() >= 2)
    run.kill("frontend")
    status, text = run.end(20)
    expect(status == 137, f"status {status}")
    says(text, "hp2_frontend was killed by signal KILL", "registering", "are stored", "the same command goes on")
    integrity(out)
    expect(0 < len(poses(out)) < len(poses(plain)), "the results of what was stored are not there")
    status, text = Script(out, "synthetic:loop").end(20)
    expect(status == 1, f"status {status}")
    says(text, "begun with another drive", "Nothing was changed")
    status, text = Script(out, DATA).end(180)
    expect(status == 0, "going on failed")
    says(text, "going on with the session")
    expect(poses(out) == poses(plain), "the poses differ after the run was gone on with")


def player_fails(folder):
    print("the player fails: a scan in the middle is truncated")
    drive = folder / "truncated"
    (drive / "velodyne").mkdir(parents=True)
    rng = random.Random(3)
    for i in range(30):
        points = [v for _ in range(2000) for v in (rng.uniform(-20, 20), rng.uniform(-20, 20), rng.uniform(-2, 5), 0.5)]
        data = struct.pack(f"<{len(points)}f", *points)
        (drive / "velodyne" / f"{i:06d}.bin").write_bytes(data if i != 25 else data[:-7])
    status, text = Script(folder / "player", drive).end(30)
    expect(status == 1, f"status {status}")
    says(text, "hp2_player ended with status 1", "000025.bin", "are stored", "results written")
    integrity(folder / "player")
    expect(len(poses(folder / "player")) == 25, f"{len(poses(folder / 'player'))} poses of 25 scans")
    summary = json.loads((folder / "player" / "summary.json").read_text())
    expect(not summary["complete"] and "missing" in " ".join(summary["warnings"]), str(summary["warnings"]))
    path = drive / "velodyne" / "000025.bin"
    whole = path.read_bytes() + b"1234567"
    print("the same with --skip-damaged, then with the file mended")
    status, text = Script(folder / "skipped", drive, "--skip-damaged").end(60)
    expect(status == 0, f"status {status}")
    summary = json.loads((folder / "skipped" / "summary.json").read_text())
    expect(summary["scans_damaged"] == 1 and "000025.bin" in " ".join(summary["warnings"]), str(summary["warnings"]))
    path.write_bytes(whole)
    status, text = Script(folder / "player", drive).end(60)
    expect(status == 0, f"status {status}")
    expect(len(poses(folder / "player")) == 30, f"{len(poses(folder / 'player'))} poses of 30 scans")
    expect(json.loads((folder / "player" / "summary.json").read_text())["complete"], "not complete")


def restarts(folder, plain):
    print("--restart: front-end, back-end and player die once each; then a stage that dies again and again")
    out = folder / "restarts"
    run = Script(out, DATA, "--restart")
    for k, name in enumerate(["frontend", "backend", "player"]):
        run.wait_for(lambda k=k: run.submaps_stored() > k)
        run.kill(name)
        run.wait_for(lambda name=name: f"hp2_{name} died (status 137): started again, 1 of 5 times" in run.text(), 20)
    status, _ = run.end(180)
    expect(status == 0, f"status {status}")
    expect(poses(out) == poses(plain), "the poses differ after restarts")
    run = Script(folder / "again", DATA, "--restart")
    for _ in range(6):
        run.kill("backend")
        time.sleep(0.5)
    status, text = run.end(60)
    expect(status == 137, f"status {status}")
    says(text, "5 of 5 times", "given up")
    expect("line " not in text, f"the shell's own words are in the output:\n{text}")


def ctrl_c(folder):
    print("Ctrl-C")
    out = folder / "ctrl_c"
    run = Script(out, DATA)
    run.wait_for(lambda: run.submaps_stored() >= 1)
    run.process.send_signal(signal.SIGINT)
    status, text = run.end(20)
    expect(status == 130, f"status {status}")
    says(text, "stopping", "are stored", "results written")
    integrity(out)
    expect(len(poses(out)) > 20, "no results after Ctrl-C")
    expect((out / "map.ply").stat().st_size > 1000 and (out / "summary.json").exists(), "no map after Ctrl-C")
    print("Ctrl-C before anything is registered, and twice")
    run = Script(folder / "early", DATA)
    run.wait_for(lambda: len(run.pids()) == 4)
    run.process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    run.process.send_signal(signal.SIGINT)
    expect(run.end(15)[0] == 130, "status")
    print("the script itself is killed: the processes go, too, and the same command goes on")
    run = Script(folder / "killed", DATA)
    run.wait_for(lambda: run.submaps_stored() >= 1)
    pids = run.pids()
    run.process.kill()
    run.process.wait()
    end = time.monotonic() + 10
    while any(pathlib.Path(f"/proc/{pid}").exists() for pid in pids):
        expect(time.monotonic() < end, "processes are left")
        time.sleep(0.1)
    integrity(folder / "killed")


def no_multicast(folder):
    print("no multicast route")
    subprocess.run(["ip", "route", "del", "224.0.0.0/4", "dev", "lo"], check=True)
    try:
        status, _ = Script(folder / "namespace", "synthetic:tiny").end(120)
        expect(status == 0, "no namespace of its own")
        tools = folder / "tools"
        tools.mkdir()
        (tools / "unshare").write_text("#!/bin/sh\nexit 1\n")
        (tools / "unshare").chmod(0o755)
        status, text = Script(folder / "refused", "synthetic:tiny",
                              environment={"PATH": f"{tools}:{os.environ['PATH']}"}).end(20)
        expect(status == 1, f"status {status}")
        says(text, "multicast does not work", "ip route add 224.0.0.0/4 dev lo")
    finally:
        subprocess.run(["ip", "route", "add", "224.0.0.0/4", "dev", "lo"], check=True)


def test():
    with Run() as run:
        if len(sys.argv) > 1:  # one part alone, e.g. ctrl_c
            return globals()[sys.argv[1]](run.folder)
        help_texts()
        session_there_already(run.folder)
        plain = run.folder / "plain"
        expect(Script(plain, DATA).end(180)[0] == 0, "the plain run failed")
        stage_dies(run.folder, plain)
        player_fails(run.folder)
        restarts(run.folder, plain)
        ctrl_c(run.folder)
        no_multicast(run.folder)


main(test)
