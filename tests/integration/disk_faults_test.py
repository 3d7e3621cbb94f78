"""The disk fails, or the process is killed, at every write and sync of a short run, in back-end and viewer: the same
command again leaves the results of an undisturbed run, bit for bit.

HP2_DISK_FAULTS_EVERY (40): every how many operations; HP2_DISK_FAULTS_AT: `PROGRAM KIND NUMBER`, this one alone."""
import concurrent.futures
import collections

from harness import *

LIBRARY = BIN.resolve() / "libhp2_failing_disk.so"
EVERY = int(os.environ.get("HP2_DISK_FAULTS_EVERY", "40"))
WORKERS = os.cpu_count() + 1  # a run waits about as long as it computes
PROGRAMS = ("hp2_backend", "hp2_viewer_headless")
# What a run that ends says of it.
KINDS = {"EIO": ("Input/output error", "disk"), "ENOSPC": ("No space left", "full"), "KILL": ("killed",)}
RESULTS = ("poses_tum.txt", "poses_kitti.txt", "map.ply", "closures.csv", "graph.g2o", "trajectory.png", "map_topdown.png")
SHORT_SUBMAPS = "frontend:\n  submap_length_m: 0.35\n  robust.start_search: false\n"  # three in eight scans
Outcome = collections.namedtuple("Outcome", "status said operations")


def play(folder, program="none", kind="none", at=0):
    """The command, with one operation of `program` failing."""
    counter = folder.with_suffix(".counter")
    counter.write_bytes(bytes(8))
    preload = [os.environ["LD_PRELOAD"]] if os.environ.get("LD_PRELOAD") else []
    environment = dict(os.environ, LD_PRELOAD=":".join([*preload, str(LIBRARY)]), HP2_DISK_PROGRAM=program,
                       HP2_DISK_FOLDER=str(folder), HP2_DISK_FAULT=kind, HP2_DISK_AT=str(at), HP2_DISK_COUNTER=str(counter))
    command = [SCRIPTS / "run_slam.sh", "synthetic:tiny", "--count", "8", "--out", folder, "--build", BIN.resolve().parent,
               "--config", folder.parent / "config.yaml", "--give-up-after", "30"]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=90 * SLOWER)
    except subprocess.TimeoutExpired as late:
        return Outcome(-1, f"it has not ended: {late.stdout}{late.stderr}", 0)
    return Outcome(done.returncode, done.stdout + done.stderr, struct.unpack("q", counter.read_bytes())[0])


def results(folder):
    return {name: (folder / name).read_bytes() for name in RESULTS if (folder / name).exists()}


def check(root, expected, program, kind, at):
    """What is wrong after this fault; nothing if the same command makes it good."""
    folder = root / f"{program}_{kind}_{at}"
    first = play(folder, program, kind, at)
    wrong = ""
    if first.status != 0 and not any(word in first.said for word in KINDS[kind]):
        wrong = "the run does not say why it ended"
    elif first.status == 0 and results(folder) != expected:
        wrong = "it ended with status 0, and its results differ"
    again = first if wrong or first.status == 0 else play(folder)
    # All had been written before it failed: then the same command may say that all is done.
    if not wrong and again.status != 0 and not ("nothing is left to do" in first.said and "is complete" in again.said):
        wrong = f"the same command ended with status {again.status}"
    elif not wrong and results(folder) != expected:
        differ = [name for name in RESULTS if results(folder).get(name) != expected[name]]
        wrong = f"the results of the same command differ: {differ}"
    if wrong:
        return f"{program} {kind} {at}: {wrong}\n--- first\n{first.said}\n--- again\n{again.said}"
    shutil.rmtree(folder, ignore_errors=True)
    return ""


def test():
    expect(LIBRARY.exists(), f"{LIBRARY} is not built")
    with Run() as run:
        root = run.folder.resolve()
        (root / "config.yaml").write_text(SHORT_SUBMAPS)
        expected, cases = None, []
        for program in PROGRAMS:
            plain = play(root / f"plain_{program}", program)
            expect(plain.status == 0, f"the undisturbed run failed: {plain.said}")
            found = results(root / f"plain_{program}")
            expect(set(found) == set(RESULTS), f"the undisturbed run wrote {sorted(found)}")
            expect(expected in (None, found), "two undisturbed runs differ")
            expected = found
            expect(plain.operations > 50, f"{program}: {plain.operations} operations are counted")
            print(f"{program}: {plain.operations} operations", flush=True)
            cases += [(program, kind, at) for k, kind in enumerate(KINDS)
                      for at in range(k * EVERY // len(KINDS), plain.operations, EVERY)]
        if os.environ.get("HP2_DISK_FAULTS_AT"):
            program, kind, at = os.environ["HP2_DISK_FAULTS_AT"].split()
            cases = [(program, kind, int(at))]
        wrong = []
        with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
            for said in filter(None, pool.map(lambda case: check(root, expected, *case), cases)):
                print(said, flush=True)
                wrong.append(said.splitlines()[0])
        expect(not wrong, f"{len(wrong)} of {len(cases)} faults do harm: {wrong}")
        print(f"{len(cases)} faults, none does harm")


main(test)
