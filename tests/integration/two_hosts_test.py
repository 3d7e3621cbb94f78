"""Two hosts (network namespaces joined by a veth pair): player and front-end on one, back-end and viewer on the other,
ttl=1; the link is cut for 20 s. The same result as on one host."""
from harness import *

DATA = "synthetic:block:2"
URL_TTL1 = "udpm://239.255.76.67:7667?ttl=1"
OTHER = None


def run_two(cut):
    run = Run(URL_TTL1)
    with run:
        prefix = ["nsenter", "-t", str(OTHER.pid), "-n"]
        run.backend(prefix=prefix)
        run.viewer("--ground-truth", DATA, prefix=prefix)
        run.frontend()
        odometry = Odometry()
        run.player(DATA)
        if cut:
            odometry.wait_for(60, 60)
            subprocess.run(["ip", "link", "set", "veth0", "down"], check=True)
            time.sleep(20)
            subprocess.run(["ip", "link", "set", "veth0", "up"], check=True)
            subprocess.run(["ip", "route", "replace", "224.0.0.0/4", "dev", "veth0"], check=True)
        run.wait(240)
        scans = len(run.poses())
        check_complete(run, scans)
        run.check_session()
        return (run.out / "poses_tum.txt").read_bytes(), scans


def test():
    global OTHER
    OTHER = subprocess.Popen(["unshare", "-n", "sleep", "1000"])
    try:
        time.sleep(0.3)
        setup = ["ip link add veth0 type veth peer name veth1", f"ip link set veth1 netns {OTHER.pid}",
                 "ip addr add 10.9.0.1/24 dev veth0", "ip link set veth0 up",
                 f"nsenter -t {OTHER.pid} -n ip addr add 10.9.0.2/24 dev veth1",
                 f"nsenter -t {OTHER.pid} -n ip link set veth1 up", f"nsenter -t {OTHER.pid} -n ip link set lo up"]
        with Run() as one:
            one.all_four(DATA)
            expected = (one.out / "poses_tum.txt").read_bytes()
            scans = len(one.poses())
        # From now on multicast leaves this host.
        setup += ["ip route replace 224.0.0.0/4 dev veth0",
                  f"nsenter -t {OTHER.pid} -n ip route add 224.0.0.0/4 dev veth1"]
        for command in setup:
            result = subprocess.run(command.split(), capture_output=True, text=True)
            if result.returncode != 0:
                print(f"skipped: {command}: {result.stderr.strip()}")
                sys.exit(SKIPPED)
        for cut in (False, True):
            poses, count = run_two(cut)
            expect(count == scans and poses == expected, f"the poses differ over two hosts (link cut: {cut})")
            print(f"two hosts, link cut: {cut}: {count} scans, the same poses")
    finally:
        OTHER.kill()


main(test)
