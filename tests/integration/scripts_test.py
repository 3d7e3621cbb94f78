"""What the scripts promise: nothing is deleted without asking, commands can be pasted, the run's LCM network is told."""
import re
import shlex

from harness import *

BUILD = BIN.resolve().parent


def run_script(name, *arguments, **options):
    return subprocess.run([str(SCRIPTS / name), *map(str, arguments)], capture_output=True, text=True, timeout=200 * SLOWER,
                          **options)


def files_in(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


def demo_deletes_nothing(folder):
    for words in (["--help"], ["-h"]):
        done = run_script("demo.sh", *words)
        expect(done.returncode == 0 and done.stdout.startswith("usage:"), f"demo.sh {words}: {done}")
    precious = folder / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("years")
    done = run_script("demo.sh", precious)
    expect(done.returncode == 1 and "--overwrite" in done.stderr, f"demo.sh on a folder that is there: {done}")
    expect(files_in(precious) == ["thesis.tex"], "demo.sh has touched a folder that is there")
    for words in (["--nonsense"], [precious, folder / "other"]):
        done = run_script("demo.sh", *words)
        expect(done.returncode == 2, f"demo.sh {words}: {done}")


def overwrite_keeps_what_is_not_its_own(folder):
    out = folder / "$(touch pasted)'s run"
    arguments = ["synthetic:tiny", "--out", out, "--build", BUILD]
    done = run_script("run_slam.sh", *arguments)
    expect(done.returncode == 0, f"run_slam.sh failed: {done}")
    url = (out / "lcm_url").read_text().strip()
    expect(url.startswith("udpm://") and url in done.stdout, f"the LCM URL is not told: {done.stdout}")
    (out / "logs" / "ride.log").write_text("mine")
    (out / "notes.txt").write_text("mine")
    done = run_script("run_slam.sh", *arguments, "--overwrite")
    expect(done.returncode == 0, f"run_slam.sh --overwrite failed: {done}")
    for path in ("logs/ride.log", "notes.txt"):
        expect((out / path).read_text() == "mine", f"--overwrite has deleted {path}")
    # The command that it suggests can be pasted as it stands.
    done = run_script("run_slam.sh", *arguments)
    expect(done.returncode == 1, f"a complete session is not refused: {done}")
    line = re.search(r"write its results once more +(.*)", done.stderr).group(1)
    expect(shlex.split(line)[-1] == str(out), f"not what the folder is called: {line}")
    again = subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True)
    expect(again.returncode == 0, f"the suggested command failed: {again}")
    expect(not (folder / "pasted").exists(), "the suggested command has executed a part of the path")


def every_reading_option_reaches_the_processes(folder):
    """The player reads the drive and the viewer its ground truth: both take what run_slam.sh passes on."""
    out = folder / "read"
    done = run_script("run_slam.sh", "synthetic:tiny", "--out", out, "--build", BUILD, "--ground-truth-topic", "/truth",
                      "--sweep", "given", "--vertical-correction", "off")
    expect(done.returncode == 0 and (out / "report.html").exists(), f"run_slam.sh with options for readers: {done}")


def control_speaks():
    done = subprocess.run([BIN / "hp2_control", "list", "--lcm-url", URL], capture_output=True, text=True)
    expect(done.returncode == 1 and "no process" in done.stdout, f"hp2_control list: {done}")
    done = subprocess.run([BIN / "hp2_control", "check", "--quick", "--lcm-url", URL], capture_output=True, text=True)
    expect(done.returncode == 0 and "multicast works" in done.stdout, f"hp2_control check --quick: {done}")
    done = subprocess.run([BIN / "hp2_control", "check", "--lcm-url", URL], capture_output=True, text=True, timeout=60)
    counts = [int(n) for n in re.findall(r"^  .*  (\d+)$", done.stdout, re.M)]
    expect(done.returncode == 0 and len(counts) == 3 and all(0 <= n <= 12 for n in counts), f"hp2_control check: {done}")
    expect("recv_buf_size" in done.stdout or "Nothing was lost" in done.stdout, f"hp2_control check names no remedy: {done.stdout}")


def reasons_are_given(folder):
    """Limits of the system are named, and never called a defect."""
    config = folder / "config.yaml"
    config.mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "small.yaml").write_text("frontend:\n  voxel_size_m: 0.1\n")
    (folder / "doubled.yaml").write_text("sensor:\n  ring_angles_deg: [1, 1, 3]\n")
    for command, reason in (
            (f"exec {BIN}/hp2_frontend --print-config --config {config}", "is a folder"),
            (f"exec {BIN}/hp2_frontend --print-config --config {folder}/pipe", "pipe"),
            (f"ulimit -n 12; exec {BIN}/hp2_frontend --lcm-url '{URL}'", "ulimit -n"),
            (f"exec {BIN}/hp2_player synthetic:tiny --info --dataset kitty", "--dataset kitty"),
            (f"exec {BIN}/hp2_player synthetic:tiny --info --sweep sideways", "sideways"),
            (f"exec {BIN}/hp2_frontend --config {folder}/small.yaml --print-config", "below 0.2 m"),
            (f"exec {BIN}/hp2_calibrate synthetic:tiny --out {folder}/nowhere/sensor.yaml", "nowhere"),
            (f"exec {BIN}/hp2_calibrate synthetic:tiny --out {folder}", "is a folder"),
            (f"exec {BIN}/hp2_frontend --config {folder}/doubled.yaml --print-config", "ring_angles_deg")):
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=30 * SLOWER)
        expect(done.returncode == 1 and reason in done.stderr and "defect" not in done.stderr, f"{command}: {done}")


def test():
    with Run() as run:
        demo_deletes_nothing(run.folder)
        control_speaks()
        reasons_are_given(run.folder)
        overwrite_keeps_what_is_not_its_own(run.folder)
        every_reading_option_reaches_the_processes(run.folder)


main(test)
