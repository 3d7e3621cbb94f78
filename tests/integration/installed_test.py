"""What `cmake --install` leaves: the launcher maps a drive from there, a stranger's program embeds the odometry by
find_package(hp2), and completion knows the options."""
from harness import *

BUILD = BIN.parent
EXAMPLE = SCRIPTS / "packaging" / "examples" / "embed"


def output(*command, status=0, **options):
    run = subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)
    expect(run.returncode == status, f"{' '.join(map(str, command))} ended with {run.returncode}:\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    return run.stdout + run.stderr


def launcher_maps(prefix, folder):
    """hp2-slam works from where it was installed, with nothing of the source or build folder."""
    environment = {"PATH": f"{prefix}/bin:/usr/bin:/bin:/usr/sbin:/sbin", "HP2_TEST_NAMESPACE": "1"}
    run = lambda *words, **options: output(*words, env=environment, cwd=folder, **options)
    expect("synthetic, 40 scans" in run("hp2-slam", "info", "synthetic:tiny"), "hp2-slam info does not say what the drive is")
    text = run("hp2-slam", "run", "synthetic:tiny", "--out", "tiny")
    expect((folder / "tiny" / "report.html").is_file(), f"hp2-slam run left no report:\n{text}")
    (folder / "tiny" / "map.ply").unlink()
    run("hp2-slam", "export", "tiny")
    expect((folder / "tiny" / "map.ply").is_file(), "hp2-slam export wrote no map")
    run("hp2-slam", "control", "check")
    error = run("hp2-slam", "exprot", "tiny", status=2)
    expect("unknown command exprot" in error and "--help" in error, f"a wrong command is not told: {error}")
    help_text = run("hp2-slam", "eval", "--help")
    expect("ATE" in help_text, "hp2-slam eval --help is not that of hp2_eval")
    completion = prefix / "share" / "bash-completion" / "completions" / "hp2-slam"
    complete = 'source "$1"; COMP_WORDS=(hp2-slam "${@:2}"); COMP_CWORD=$(($# - 1)); _hp2 hp2-slam; echo "${COMPREPLY[*]}"'
    words = run("bash", "-c", complete, "_", completion, "ex").split()
    expect(words == ["export"], f"hp2-slam ex completes to {words}")
    words = run("bash", "-c", complete, "_", completion, "player", "--star").split()
    expect(words == ["--start-paused"], f"hp2-slam player --star completes to {words}")


def live_maps(prefix, folder):
    """hp2-slam live, as the systemd unit runs it, stores and writes what a driver sent when it is told to stop."""
    environment = {**os.environ, "PATH": f"{prefix}/bin:{os.environ['PATH']}"}
    log = folder / "live.log"
    with open(log, "w") as file:
        live = subprocess.Popen(["hp2-slam", "live", "--out", folder / "robot", "--live-backlog", "1000"], env=environment, stderr=file)
    try:
        patience = Patience(60)
        while "waiting for scans" not in log.read_text():
            expect(patience.lasts() and live.poll() is None, f"hp2-slam live does not wait for scans:\n{log.read_text()}")
            time.sleep(0.05)
        odometry = Odometry()
        output("hp2_injector", "--scans", 30, "--quiet", env=environment)
        odometry.wait_for(29, 60)
        live.terminate()
        live.wait(timeout=90 * SLOWER)
    finally:
        live.kill()
    expect(live.returncode == 0, f"hp2-slam live ended with {live.returncode}:\n{log.read_text()[-2000:]}")
    poses = (folder / "robot" / "latest" / "poses_tum.txt").read_text().splitlines()
    expect(len([p for p in poses if not p.startswith("#")]) == 30, f"{len(poses)} poses of 30 scans:\n{log.read_text()[-2000:]}")


def stranger_embeds(prefix, folder):
    """The example builds outside of the repository and finds its way."""
    shutil.copytree(EXAMPLE, folder / "embed")
    build = folder / "embed" / "build"
    output("cmake", "-S", folder / "embed", "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_CXX_FLAGS=-O1")
    output("cmake", "--build", build)
    expect("error of the last position: 0.0" in output(build / "embed"), "the embedded odometry is off by 0.1 m")


def test():
    if SLOWER > 1:
        print("skipped: libraries with sanitizers are not for installing")
        sys.exit(SKIPPED)
    with Run() as run:
        prefix = run.folder / "prefix"
        for component in ("runtime", "dev"):
            output("cmake", "--install", BUILD, "--prefix", prefix, "--component", component)
        launcher_maps(prefix, run.folder)
        live_maps(prefix, run.folder)
        stranger_embeds(prefix, run.folder)


main(test)
