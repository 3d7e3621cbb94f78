"""lcm-logger records a run; lcm-logplayer replays its scans into a front-end of a new session: the same poses."""
from harness import *

DATA = "synthetic:tiny"
SCANS = 40


def test():
    if shutil.which("lcm-logger") is None or shutil.which("lcm-logplayer") is None:
        print("skipped: lcm-logger and lcm-logplayer are not installed (liblcm-bin)")
        sys.exit(SKIPPED)
    # Neither the logger nor a live scan asks for a lost datagram again, and a busy machine loses some: a recording with
    # a gap is made again, a little slower.
    for speed in (0.5, 0.2, 0.1):
        if record_and_replay(speed):
            return
    expect(False, "three recordings and replays in a row have lost scans")


def record_and_replay(speed):
    """False if a scan got lost on the way; fails if all came and the poses differ."""
    with Run() as live, Run() as replayed:
        log = live.folder / "log.lcm"
        logger = subprocess.Popen(["lcm-logger", "-q", "--lcm-url=" + live.url + "&recv_buf_size=8000000", str(log)],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(0.5)
        live.all_four(DATA)
        logger.terminate()
        logger.wait()
        check_complete(live, SCANS)

        replayed.backend()
        replayed.viewer()
        replayed.frontend("--live-backlog", 1000)
        replayed.wait_for_log("frontend", "waiting for scans", 20)
        subprocess.run(["lcm-logplayer", "-s", str(speed), "-e", "HP2_CHUNK_SCAN", "-l", replayed.url, str(log)],
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(2.0)
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", replayed.url], check=True)
        replayed.wait(60 * SLOWER)
        if len(replayed.poses()) < SCANS:
            print(f"{len(replayed.poses())} of {SCANS} scans came through at speed {speed}")
            return False
        check_complete(replayed, SCANS)
        expect(same_poses(live, replayed), "the poses of the replay differ")
        return True

main(test)
