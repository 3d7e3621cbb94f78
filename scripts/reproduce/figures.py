"""Writes the pages with figures: the odometry's accuracy and speed on every drive that is found.

usage: scripts/figures.sh DATA_ROOT [--build DIR] [--threads N] [--only NAME,...] [--keep]

DATA_ROOT holds the drives by the names in scripts/reproduce/figures.json; drives that are absent are listed and left out.
  --build DIR    build folder (default: build)
  --threads N    threads of the front-end (default 2)
  --only NAMES   these drives only, separated by commas
  --keep         rows of drives that are not run now stay as they are on the page, with their own commit
Writes frontend/docs/figures.md, and the six rows of the README between its two result marks.
Exit status: 0 written; 1 no drive was found or a run failed; 2 wrong command line.
"""
import argparse
import datetime
import json
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PAGE = ROOT / "frontend" / "docs" / "figures.md"
README = ROOT / "README.md"
MARKS = ("<!-- results: written by scripts/figures.sh -->", "<!-- end of results -->")


def commit():
    """Short hash of the sources; a plus says that files were changed since."""
    head = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    changed = subprocess.run(["git", "-C", str(ROOT), "status", "--porcelain", "--untracked-files=no", "*.cpp", "*.hpp"],
                             capture_output=True, text=True)
    return (head.stdout.strip() or "unknown") + ("+" if changed.stdout.strip() else "")


def processor():
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text()
        return re.search(r"model name\s*: (.*)", text).group(1)
    except (OSError, AttributeError):
        return platform.machine()


def measure(bench, drive, threads):
    """hp2_bench's figures of one drive."""
    with tempfile.TemporaryDirectory() as folder:
        json_file = pathlib.Path(folder) / "bench.json"
        run = subprocess.run([str(bench), str(drive), "--threads", str(threads), "--json", str(json_file)],
                             capture_output=True, text=True)
        if run.returncode != 0:
            raise RuntimeError(run.stderr.strip()[-400:])
        return json.loads(json_file.read_text())


def metres(value):
    """A length as a table shows it: three significant digits or millimetres."""
    if value is None:
        return "–"
    return f"{value:.3f}" if value < 1 else f"{value:.3g}"


def row_of(entry, figures, source, when):
    """A row of the page, as a list of cells."""
    ate = figures["accuracy"]["ate"]["rmse"] if figures.get("accuracy") else None
    nees = figures.get("normalised_error_squared") or {}
    cells = [entry["title"], str(figures["scans"]), metres(ate)]
    cells += [metres(peer) for peer in entry["peers"]]
    cells += [f"{figures['total']['median']:.1f}", f"{figures['total']['p99']:.1f}", f"{figures['iterations_per_scan']:.1f}",
              str(figures["lost"]), f"{nees['mean']:.1f}" if nees.get("mean") is not None else "–", f"{source}, {when}"]
    return cells


def rows_on_page():
    """Rows that the page has now, by title."""
    rows = {}
    if PAGE.is_file():
        for line in PAGE.read_text().splitlines():
            cells = [c.strip() for c in line.strip().strip("|").split("|")]
            if line.startswith("|") and len(cells) > 5:
                rows[cells[0]] = cells
    return rows


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows])


def write_pages(rows, known, command):
    """The page, and its rows for the README."""
    head = ["drive", "scans", "ATE [m]", *known["peers"], "ms per scan, median", "p99", "iterations", "lost", "NEES", "commit, date"]
    simulated = [f"| {e['title']} | `lidarsim generate {e['simulate']}` |" for e in known["drives"] if "simulate" in e]
    PAGE.write_text(f"""# Figures of the odometry

Accuracy and speed of the front-end alone, one configuration (the defaults) for all drives. Written by `{command}` on
{platform.machine()}, {processor()}, at a load average of {os.getloadavg()[1]:.1f} on {os.cpu_count()} processors; do not edit.

{table(head, rows)}

- **ATE**: RMSE of the positions after SE(3) alignment, `hp2_bench DATA`. Closures are not used.
- **{', '.join(known['peers'])}**: ATE of their own defaults on the same files, measured once, from `scripts/reproduce/figures.json`.
- **ms per scan**: reading excluded; comparable only where the load average is below the number of processors. **NEES**: normalised error squared of the motion per scan,
  6 for an honest covariance.
- **lost**: scans whose pose is a prediction.

| simulated drive | made by |
|---|---|
""" + "\n".join(simulated) + "\n")
    chosen = {e["title"] for e in known["drives"] if e.get("readme")}
    short = [[r[0], r[2], *r[3:3 + len(known["peers"])]] for r in rows if r[0] in chosen]
    block = "\n".join([
        MARKS[0], "ATE [m] of the odometry alone, without closures, one configuration for all. All drives, times, commits: "
        "[figures](frontend/docs/figures.md).", "",
        table(["drive", "HP2-SLAM", *known["peers"]], short), MARKS[1]])
    text = README.read_text()
    before, _, rest = text.partition(MARKS[0])
    README.write_text(before + block + rest.partition(MARKS[1])[2])


def main():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n")[0], description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", default="")
    parser.add_argument("--keep", action="store_true")
    options = parser.parse_args()
    bench = options.build / "bin" / "hp2_bench"
    if not bench.is_file():
        print(f"figures.sh: {bench} is not there. Build first: scripts/setup.sh (or give --build DIR).", file=sys.stderr)
        return 1
    known = json.loads((HERE / "figures.json").read_text())
    only = set(options.only.split(",")) if options.only else None
    before = rows_on_page() if options.keep else {}
    rows, measured, failed = [], 0, 0
    for entry in known["drives"]:
        folder = options.root / entry["name"]
        chosen = only is None or entry["name"] in only
        if chosen and folder.is_dir():
            try:
                figures = measure(bench, folder, options.threads)
                rows.append(row_of(entry, figures, commit(), datetime.date.today().isoformat()))
                measured += 1
                print(" | ".join(rows[-1]), flush=True)
                continue
            except (RuntimeError, KeyError) as error:
                failed += 1
                print(f"figures.sh: {entry['name']} failed: {error}", file=sys.stderr)
        elif chosen:
            print(f"{entry['name']} is not in {options.root}: left out")
        if entry["title"] in before:
            rows.append(before[entry["title"]])
    if not measured:
        print(f"figures.sh: no drive of scripts/reproduce/figures.json was measured in {options.root}", file=sys.stderr)
        return 1
    write_pages(rows, known, "scripts/figures.sh DATA_ROOT" + (f" --threads {options.threads}" if options.threads != 2 else ""))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
