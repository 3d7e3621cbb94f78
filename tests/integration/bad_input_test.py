"""What a user gets wrong: a message that says what, where and what to do; nothing crashes, nothing hangs."""
from harness import *


def run_slam(*arguments, seconds=60):
    started = time.monotonic()
    try:
        result = subprocess.run([SCRIPTS / "run_slam.sh", *map(str, arguments), "--build", BIN.parent], text=True,
                                capture_output=True, timeout=seconds * SLOWER)
    except subprocess.TimeoutExpired as e:
        raise Failure(f"run_slam.sh {arguments} hangs: {e.stderr}") from None
    text = result.stdout + result.stderr
    print(f"[{time.monotonic() - started:.1f} s, status {result.returncode}] {' '.join(map(str, arguments))}\n"
          + "".join(f"    {line}\n" for line in text.strip().splitlines()[-6:]))
    return result.returncode, text


def refused(words, *arguments):
    status, text = run_slam(*arguments)
    expect(0 < status < 126, f"status {status}")
    for word in words:
        expect(word in text, f'the message does not say "{word}"')


def make_drive(folder, scans=8):
    (folder / "velodyne").mkdir(parents=True)
    rng = random.Random(3)
    for i in range(scans):
        points = [v for _ in range(2000) for v in (rng.uniform(-20, 20), rng.uniform(-20, 20), rng.uniform(-2, 5), 0.5)]
        (folder / "velodyne" / f"{i:06d}.bin").write_bytes(struct.pack(f"<{len(points)}f", *points))
    return folder


def test():
    with Run() as run:
        out = run.folder / "o"
        refused(["/does/not/exist"], "/does/not/exist", "--out", out)
        (run.folder / "empty").mkdir()
        refused([str(run.folder / "empty")], run.folder / "empty", "--out", out)
        refused(["synthetic", "loop"], "synthetic:lopp", "--out", out)
        refused(["cannot be written", "--out"], "synthetic:tiny", "--out", "/dev/null/x")
        config = run.folder / "bad.yaml"
        config.write_text("frontend:\n  voxel_sise_m: 1\n")
        refused(["voxel_sise_m", "frontend.voxel_size_m", "line 2"], "synthetic:tiny", "--out", out, "--config", config)
        refused(["--rate", "fast"], "synthetic:tiny", "--out", out, "--rate", "fast")
        refused(["hybird"], "synthetic:tiny", "--out", out, "--mode", "hybird")
        refused(["40 scans", "--first"], "synthetic:tiny", "--out", out, "--first", "1000000")

        # A scan in the middle is truncated: what was registered before it is stored and written.
        drive = make_drive(run.folder / "truncated")
        path = drive / "velodyne" / "000005.bin"
        path.write_bytes(path.read_bytes()[:-7])
        refused(["000005.bin"], drive, "--out", run.folder / "t")

        # A session file that is damaged, a session folder that is none.
        session = run.folder / "d" / "session"
        session.mkdir(parents=True)
        (session / "session.sqlite").write_bytes(b"SQLite format 3\0" + os.urandom(8000))
        refused(["session.sqlite"], "synthetic:tiny", "--out", run.folder / "d")
        (run.folder / "f").mkdir()
        (run.folder / "f" / "session").write_text("a file")
        refused(["session"], "synthetic:tiny", "--out", run.folder / "f")


main(test)
