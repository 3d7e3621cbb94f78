"""Speed and memory of the whole system, one table; scripts/benchmark.sh --help."""
import argparse
import dataclasses
import os
import pathlib
import statistics
import sys

import drives
import runs
from reproduce import REPOSITORY, check, machine, stop
from tables import Table

STAGES = {"preprocess": "preprocessing", "neighbour_search": "neighbour search", "planarity": "planarity",
          "solve": "solving", "map_update": "map update"}
PROCESSES = ["hp2_player", "hp2_frontend", "hp2_backend", "hp2_viewer_headless"]
EPILOG = """\
For each drive: hp2_bench (the front-end in one process, reading excluded) with --threads and with one thread, then the
four processes over LCM in lockstep (scripts/run_slam.sh). Each is run --repeat times; times are the medians over the
repetitions of each run's own statistic, memory is the largest. Results: benchmark.md and benchmark.csv in --out.
A figure is worth something only if nothing else runs on the machine.

example: scripts/benchmark.sh /data/kitti/sequences/07 synthetic:loop --out out/benchmark
"""


def parse(arguments):
    parser = argparse.ArgumentParser(prog="benchmark.sh", epilog=EPILOG, description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="+", metavar="DATA", help="drives, folders of drives, or synthetic:SCENE")
    parser.add_argument("--out", required=True, metavar="DIR", help="where the results go")
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="threads of the front-end (default: 2)")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="so often (default: 3)")
    parser.add_argument("--config", metavar="FILE", help="settings (YAML) for all runs")
    parser.add_argument("--count", type=int, default=0, metavar="N", help="at most so many scans of each drive")
    parser.add_argument("--build", default=os.environ.get("HP2_BUILD_DIR", REPOSITORY / "build"), metavar="DIR",
                        help="build folder (default: build)")
    options = parser.parse_args(arguments)
    if options.repeat < 1 or options.threads < 1:
        parser.error("--repeat and --threads are at least 1")
    return options


def measure(runner, drive, repeat):
    """Every figure of one drive: {row's name: number}."""
    single = runs.Runner(runner.build, runner.out, 1, runner.config, again=True)
    single.selection = runner.selection
    benches, ones, slams = [], [], []
    for k in range(repeat):
        runner.label = f"{drive.name}, {k + 1} of {repeat}"
        runner.begin()
        benches.append(runner.bench(drive, "benchmark"))
        ones.append(single.bench(drive, "one_thread"))
        slams.append(runner.slam(drive))
        rate = 1e3 / benches[-1]["total"]["mean"]
        runner.say(f"{runner.label}: {benches[-1]['total']['median']:.2f} ms a scan, {slams[-1]['scans_per_s']:.1f} of "
                   f"{rate:.1f} scans/s")
    typical = lambda values: float(statistics.median(values))
    n = runner.threads
    rows = {"scans": benches[0]["scans"], "points a scan": round(benches[0]["points_per_scan"])}
    for stage, name in STAGES.items():
        rows[f"{name}, ms median ({n} threads)"] = typical(b[stage]["median"] for b in benches)
    rows[f"front-end, ms median ({n} threads)"] = typical(b["total"]["median"] for b in benches)
    rows[f"front-end, ms p99 ({n} threads)"] = typical(b["total"]["p99"] for b in benches)
    rows["p99 / median"] = typical(b["total"]["p99"] / b["total"]["median"] for b in benches)
    rows["front-end, ms median (1 thread)"] = typical(b["total"]["median"] for b in ones)
    rows["scans/s, hp2_bench"] = typical(1e3 / b["total"]["mean"] for b in benches)
    rows["scans/s, four processes"] = typical(s["scans_per_s"] for s in slams)
    rows["four processes / hp2_bench"] = rows["scans/s, four processes"] / rows["scans/s, hp2_bench"]
    submaps = [s["backend_ms"]["submaps"] for s in slams if s["backend_ms"] and s["backend_ms"]["submaps"]]
    rows["submaps"] = slams[0]["submaps"]
    rows["back-end, ms a submap, median"] = typical(statistics.median(ms) for ms in submaps) if submaps else None
    rows["back-end, ms a submap, worst"] = typical(max(ms) for ms in submaps) if submaps else None
    rows["back-end, ms at the end"] = typical(s["backend_ms"]["finish"] for s in slams if s["backend_ms"])
    rows["peak memory, MB: hp2_bench"] = max(b["peak_memory_mb"] for b in benches)
    for process in PROCESSES:
        known = [s["peak_memory_mb"].get(process) for s in slams if s["peak_memory_mb"].get(process)]
        rows[f"peak memory, MB: {process}"] = float(max(known)) if known else None
    spread = [b["total"]["median"] for b in benches]
    rows["hp2_bench's median, least to most"] = f"{min(spread):.2f} to {max(spread):.2f}"
    return rows


def main():
    options = parse(sys.argv[1:])
    for data in options.data:
        options.data_root = data
        check(options)
    found = []
    for drive in (d for data in options.data for d in drives.find(data)):
        while any(d.name == drive.name for d in found):  # of another folder
            drive = dataclasses.replace(drive, name=drive.name + "_")
        found.append(drive)
    if not found:
        stop(f"there is no drive in {', '.join(options.data)}.")
    runner = runs.Runner(options.build, options.out, options.threads, options.config, count=options.count, again=True)
    table = Table("Speed and memory", "", [])
    measured = {}
    try:
        for drive in found:
            try:
                measured[drive] = measure(runner, drive, options.repeat)
            except runs.RunFailed as failure:
                runner.failures.append(drive.name)
                runner.say(f"{drive.name}: FAILED, the others go on: {failure}")
    except KeyboardInterrupt:
        stop("stopped.", 130)
    if measured:
        table.columns = [d.name for d in measured]
        for row in next(iter(measured.values())):
            table.add(row, [rows[row] for rows in measured.values()])
        command = "scripts/benchmark.sh " + " ".join(sys.argv[1:])
        table.notes = [f"`{command}` on {machine()}; each {options.repeat} times, medians. Load when it ended: "
                       f"{os.getloadavg()[0]:.1f}."]
        print("\n" + table.text(), end="")
        out = pathlib.Path(options.out)
        (out / "benchmark.md").write_text(table.markdown(), encoding="utf-8")
        (out / "benchmark.csv").write_text(table.csv(), encoding="utf-8")
        print(f"\nwritten to {out.resolve()}: benchmark.md, benchmark.csv, runs/")
    sys.exit(1 if runner.failures else 0)


if __name__ == "__main__":
    main()
