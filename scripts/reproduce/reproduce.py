"""Runs the paper's tables and figures on the data that is on this disk; scripts/reproduce.sh --help."""
import argparse
import os
import pathlib
import platform
import re
import signal
import sys

import drives
import experiments
import paper
import runs

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
ACCURACY = ["mulran", "kitti", "helipr", "apollo"]
TABLES = ACCURACY + ["ablation", "runtime", "sensitivity"]
EPILOG = """\
TABLE
  mulran, kitti, helipr, apollo   ATE of the whole system on every such drive under DATA_ROOT
  ablation       the front-end alone: hybrid, point_to_point, point_to_plane, fixed_alpha, fixed_threshold, the default
  runtime        milliseconds a scan: neighbour search, PCA, ICP, back-end, total
  sensitivity    ATE over tau_ref (or --parameter n_ref, n_min, tau_min, tau_max, all), with its figure
  all            all of them, as far as there is data

DATA_ROOT is searched for drives, told by how their folders look (README.md, "Data sets"). The last three tables take
any drive; DATA_ROOT may be one itself, or synthetic:SCENE.

Results in --out: TABLE.md (with the figures), TABLE.csv and more .csv, figures/*.png and *.svg, runs/ (each drive's own
results and logs). What is finished there already from the same command is not run again (--again does).
Exit status: 0 everything ran, 1 something failed or nothing was found, 2 wrong use.

examples:
  scripts/reproduce.sh kitti /data/kitti --out out/kitti            # /data/kitti/sequences/00 ... and poses/
  scripts/reproduce.sh helipr /data/helipr --out out/helipr --drives 'Bridge.*/Avia'
  scripts/reproduce.sh ablation /data/my_drive --out out/mine
  scripts/reproduce.sh ablation /data/drives --leave-one-out --out out/parts
  scripts/reproduce.sh sensitivity synthetic:loop --out out/loop --parameter all
"""


def parse(arguments):
    parser = argparse.ArgumentParser(prog="reproduce.sh", epilog=EPILOG, description=paper.load()["source"]["title"],
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", metavar="TABLE", choices=TABLES + ["all"], help="which one; see below")
    parser.add_argument("data_root", metavar="DATA_ROOT", help="folder with the drives")
    parser.add_argument("--out", required=True, metavar="DIR", help="where the results go")
    parser.add_argument("--drives", metavar="REGEX", default="", help="only drives whose path matches")
    parser.add_argument("--parameter", action="append", metavar="P", choices=[*experiments.GRIDS, "all"],
                        help="sensitivity: of what; may be given again (default: tau_ref)")
    parser.add_argument("--leave-one-out", action="store_true",
                        help="ablation: mode robust without each of its parts instead, medians of five settings")
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="threads of the front-end (default: 2)")
    parser.add_argument("--config", metavar="FILE", help="settings (YAML) for all runs")
    parser.add_argument("--mode", metavar="M", help="the front-end's residuals, not for ablation")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="skip so many scans of each drive")
    parser.add_argument("--count", type=int, default=0, metavar="N", help="at most so many scans of each drive")
    parser.add_argument("--again", action="store_true", help="run anew what is there already")
    parser.add_argument("--build", default=os.environ.get("HP2_BUILD_DIR", REPOSITORY / "build"), metavar="DIR",
                        help="build folder (default: build)")
    return parser.parse_args(arguments)


def stop(text, status=1):
    print(f"reproduce.sh: {text}", file=sys.stderr)
    sys.exit(status)


def check(options):
    """What would fail hours later is said now."""
    missing = [p for p in ("hp2_player", "hp2_frontend", "hp2_backend", "hp2_viewer_headless", "hp2_control", "hp2_bench",
                           "hp2_eval", "hp2_chart") if not os.access(pathlib.Path(options.build, "bin", p), os.X_OK)]
    if missing:
        stop(f"{', '.join(missing)} is not in {options.build}/bin. Build first: scripts/setup.sh (or give --build DIR).")
    if not options.data_root.startswith("synthetic:") and not os.path.exists(options.data_root):
        stop(f"there is nothing at {options.data_root}. Check the path of the data.")
    if options.config and not os.access(options.config, os.R_OK):
        stop(f"the configuration cannot be read: {options.config}. Check the path.")
    try:
        os.makedirs(options.out, exist_ok=True)
        probe = pathlib.Path(options.out, ".writable")
        probe.touch()
        probe.unlink()
    except OSError as error:
        stop(f"the output folder cannot be written: {options.out} ({error.strerror}). Choose another one with --out.")


def run(runner, data, table, found, options):
    if table in ACCURACY:
        return experiments.accuracy(runner, data, table, found)
    if table == "ablation" and options.leave_one_out:
        return experiments.leave_one_out(runner, "leave_one_out", found)
    if table == "ablation":
        return experiments.ablation(runner, data, table, found)
    if table == "runtime":
        return experiments.runtime(runner, data, table, found)
    parameters = options.parameter or ["tau_ref"]
    return experiments.sensitivity(runner, data, table, found,
                                   list(experiments.GRIDS) if "all" in parameters else parameters)


def write(runner, result, command):
    """TABLE.md, *.csv; prints the tables."""
    text = [f"# {result.name}", "", f"`{command}` on {machine()}", ""]
    for name, table in result.tables.items():
        print("\n" + table.text(), end="")
        (runner.out / f"{name}.csv").write_text(table.csv(), encoding="utf-8")
        text += [table.markdown(), f"[{name}.csv]({name}.csv)", ""]
    if result.figures:
        text += ["## Figures", ""]
    for picture, shows in result.figures:
        if picture.endswith(".png"):
            vector = picture[:-4] + ".svg"
            text += [f"![{shows}](figures/{picture})", "", f"{shows} ([SVG](figures/{vector}))", ""]
    (runner.out / f"{result.name}.md").write_text("\n".join(text), encoding="utf-8")


def machine():
    """Processor, cores and system, for people."""
    try:
        names = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo", encoding="utf-8")
                 if line.startswith("model name")]
    except OSError:
        names = []
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}"


def main():
    options = parse(sys.argv[1:])
    check(options)
    data = paper.load()
    found = drives.find(options.data_root)
    found = [d for d in found if re.search(options.drives, d.path)]
    wanted = TABLES if options.table == "all" else [options.table]
    for table in [t for t in wanted if t in ACCURACY]:
        if not any(d.format == data["tables"][table]["format"] for d in found):
            print(f"{table}: no such drive under {options.data_root}, skipped")
            wanted.remove(table)
    if not found or not wanted:
        kinds = sorted({d.format for d in found})
        stop(f"there is nothing to run: under {options.data_root} are " +
             (f"{len(found)} drives, of other formats ({', '.join(kinds)})" if found else "no drives") +
             '. README.md, "Data sets", says how each format lies on disk.')
    print(f"{len(found)} drives under {options.data_root}: " + ", ".join(f"{d.name} ({d.format})" for d in found))
    runner = runs.Runner(options.build, options.out, options.threads, options.config, options.mode, options.first,
                         options.count, options.again)
    command = "scripts/reproduce.sh " + " ".join(sys.argv[1:])
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        for table in wanted:
            write(runner, run(runner, data, table, found, options), command)
    except KeyboardInterrupt:
        stop("stopped. The same command goes on from here.", 130)
    except runs.RunFailed as failure:
        stop(str(failure))
    print(f"\nwritten to {runner.out}: " + ", ".join(f"{t}.md" for t in wanted) + ", *.csv, figures/, runs/")
    if runner.failures:
        print(f"\n{len(runner.failures)} failed:", file=sys.stderr)
        for what, why in runner.failures:
            print(f"  {what}: {why}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
