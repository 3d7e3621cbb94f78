"""A front-end whose submaps make no sense: the back-end asks again a few times, then gives up and says why."""
from harness import *


def test():
    with Run() as run:
        backend = run.backend()
        run.start("bad_frontend", run.url, program="hp2_bad_frontend")
        started = time.monotonic()
        status = backend.wait(30 * SLOWER)
        print(f"given up after {time.monotonic() - started:.1f} s: {run.log('backend').strip().splitlines()[-1]}")
        expect(status == 1, f"the back-end ended with status {status}")
        for words in ("submap 0 cannot be stored", "no valid submap_t", "asked 5 times", "same release"):
            expect(words in run.log("backend"), f'the message does not say "{words}"')
        run.check_session()
        # The session is as good as before: a proper front-end goes on with it.
        run.processes["bad_frontend"].kill()
        run.processes["bad_frontend"].wait()
        run.processes.clear()
        run.all_four("synthetic:tiny")
        check_complete(run, 40)


main(test)
