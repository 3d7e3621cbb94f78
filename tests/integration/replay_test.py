"""lcm-logger records a run; lcm-logplayer replays its scans into a front-end of a new session: the same poses."""
from harness import *

DATA = "synthetic:tiny"
SCANS = 40


def test():
    if shutil.which("lcm-logger") is None or shutil.which("lcm-logplayer") is None:
        print("skipped: lcm-logger and lcm-logplayer are not installed (liblcm-bin)")
        sys.exit(SKIPPED)
    with Run() as live, Run() as replayed:
        log = live.folder / "log.lcm"
        logger = subprocess.Popen(["lcm-logger", "-q", "--lcm-url=" + live.url + "&recv_buf_size=8000000", str(log)],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(0.5)
        live.all_four(DATA)
        logger.terminate()
        logger.wait()

        replayed.backend()
        replayed.viewer()
        replayed.frontend("--live-backlog", 1000)
        replayed.wait_for_log("frontend", "waiting for scans", 20)
        subprocess.run(["lcm-logplayer", "-s", "0.5", "-e", "HP2_CHUNK_SCAN", "-l", replayed.url, str(log)],
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(2.0)
        subprocess.run([BIN / "hp2_control", "stop", "--target", "hp2_frontend", "--lcm-url", replayed.url], check=True)
        replayed.wait(60)
        check_complete(replayed, SCANS)
        expect(same_poses(live, replayed), "the poses of the replay differ")


main(test)
