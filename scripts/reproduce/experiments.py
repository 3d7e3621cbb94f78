"""The paper's experiments: each function runs its drives and returns tables and figures."""
import dataclasses
import statistics
import time

import drives as drives_module
import paper
from runs import RunFailed
from tables import Table

STAGES = {"preprocess": "Preprocess", "neighbour_search": "Neighbor search", "planarity": "PCA", "solve": "ICP",
          "map_update": "Map update"}
ABLATION = ["hybrid", "point_to_point", "point_to_plane", "fixed_alpha", "fixed_threshold"]
GRIDS = {
    "tau_ref": [0.005, 0.007, 0.01, 0.014, 0.02, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.3],
    "n_ref": [5, 7, 10, 14, 20, 27, 38, 54, 80],
    "n_min": [3, 4, 5, 7, 10, 14, 20],
    "tau_min": [0.0, 0.005, 0.01, 0.02, 0.05, 0.1],
    "tau_max": [0.05, 0.1, 0.15, 0.2, 0.3, 0.34],
}
LOGARITHMIC = {"tau_ref", "n_ref", "n_min"}


@dataclasses.dataclass
class Result:
    """What an experiment leaves: tables by the name of their file, figures as (file, what it shows)."""
    name: str
    tables: dict = dataclasses.field(default_factory=dict)
    figures: list = dataclasses.field(default_factory=list)
    remarks: list = dataclasses.field(default_factory=list)


def _each(runner, what, items, work):
    """work(item) for all; one that fails is reported and leaves None. Returns the results in order."""
    results = []
    for i, (name, item) in enumerate(items):
        runner.label = f"[{i + 1}/{len(items)}] {what} {name}"
        runner.begin()
        started = time.monotonic()
        try:
            text, value = work(item)
            runner.say(f"{runner.label}: {text} ({time.monotonic() - started:.0f} s)")
        except RunFailed as failure:
            value = None
            runner.failures.append((f"{what} {name}", str(failure)))
            runner.say(f"{runner.label}: FAILED, the others go on: {failure}")
        results.append(value)
    return results


def _ate(accuracy):
    return accuracy["ate"]["rmse"] if accuracy else None


def _mean(values):
    known = [v for v in values if v is not None]
    return statistics.fmean(known) if known else None


def _columns(table, found):
    """The table's columns and then one for each drive that belongs in none: (name, its drives)."""
    columns = [(c["name"], [d for d in found if drives_module.in_column(d, c)]) for c in table["columns"]]
    known = {d for _, members in columns for d in members}
    return columns, [(d.name, [d]) for d in found if d not in known]


def _remark_absent(result, columns):
    absent = [name for name, members in columns if not members]
    if absent:
        result.remarks.append("Not found under the root, skipped: " + ", ".join(absent) + ".")


# ---------------------------------------------------------------- ATE tables


def accuracy(runner, data, name, found):
    """A table of absolute trajectory errors: the whole system on every drive, beside the paper's figures."""
    table = data["tables"][name]
    found = [d for d in found if d.format == table["format"]]
    result = Result(name)
    columns, others = _columns(table, found)
    _remark_absent(result, columns)

    def work(drive):
        summary = runner.slam(drive)
        ate = _ate((summary["accuracy"] or {}).get("final"))
        again = ", from before" if summary["reused"] else ""
        return (f"{summary['poses_out']} scans{again}, ATE {ate:.3f} m" if ate is not None
                else f"{summary['poses_out']} scans{again}, no ground truth"), summary

    outcomes = dict(zip(found, _each(runner, table["title"], [(d.name, d) for d in found], work)))

    def cell(members, which):
        if not members:
            return None
        ates = [_ate((outcomes[d]["accuracy"] or {}).get(which)) for d in members if outcomes[d]]
        if not any(v is not None for v in ates):
            return "no truth" if all(outcomes[d] for d in members) else "failed"
        return _mean(ates)

    averages = any("average" in row for row in table["rows"])
    names = [c for c, _ in columns] + [c for c, _ in others]
    comparison = Table(f"{table['title']}: {table['unit']}", "Method", names + (["AVG"] if averages else []), rank=True)
    for row in table["rows"]:
        method = row["method"] + (" (paper)" if row.get("ours") else "")
        comparison.add(method, row["values"] + [None] * len(others) + ([row["average"]] if averages else []))
    comparison.groups.append(len(comparison.rows))
    for label, which in [("HP²-SLAM (this run)", "final"), ("its odometry alone", "odometry")]:
        cells = [cell(members, which) for _, members in columns + others]
        complete = all(isinstance(v, float) for v in cells[: len(columns)])
        average = [_mean(cells[: len(columns)]) if complete else None] if averages else []
        comparison.add(label, cells + average)
    comparison.unranked.append(len(comparison.rows) - 1)
    comparison.notes.append(f"Paper's figures: {paper.source_text(data, table)}. Ours: RMSE after SE(3) alignment.")
    if runner.selection:
        comparison.notes.append(f"Ours are of a part of each drive ({' '.join(runner.selection)}): not to be compared.")
    many = [f"{c}: mean of {', '.join(d.name for d in members)}" for c, members in columns if len(members) > 1]
    if many:
        comparison.notes.append("; ".join(many) + ".")
    comparison.notes += result.remarks
    result.tables[name] = comparison
    result.tables[f"{name}_drives"] = _drive_table(table, found, outcomes)
    for drive in found:
        if outcomes[drive] and outcomes[drive]["accuracy"]:
            try:
                stem = drive.name if drive.name.lower().startswith(name) else f"{name}_{drive.name}"
                pictures = runner.trajectory_figures(drive, outcomes[drive]["folder"], stem)
                result.figures += [(p, f"{drive.name}: {'error along the path' if '_errors.' in p else 'trajectory'}")
                                   for p in pictures]
            except RunFailed as failure:
                runner.failures.append((f"figures of {drive.name}", str(failure)))
    return result


def _drive_table(table, found, outcomes):
    """Everything else that is worth knowing of each drive."""
    out = Table(f"{table['title']}: each drive", "Drive",
                ["scans", "path [m]", "ATE [m]", "odometry's ATE [m]", "KITTI drift [%]", "[deg/100 m]", "closures",
                 "lost scans", "ms a scan", "report"], digits=3)
    for drive in found:
        s = outcomes[drive]
        if s is None:
            out.add(drive.name, ["failed"] + [None] * 9)
            continue
        final = (s["accuracy"] or {}).get("final")
        odometry = (s["accuracy"] or {}).get("odometry")
        kitti = final["kitti"] if final else {}
        out.add(drive.name, [s["poses_out"], float(s["path_m"]), _ate(final), _ate(odometry), kitti.get("t_percent"),
                             kitti.get("r_deg_per_100m"), s["closures"]["accepted"], s["states"]["lost"],
                             s["milliseconds"]["total"]["mean"], f"runs/{s['folder'].name}/report.html"])
    return out


# ---------------------------------------------------------------- ablation


def ablation(runner, data, name, found):
    """The front-end alone with each kind of residual, on any drives."""
    table = data["tables"][name]
    result = Result(name)
    columns, others = _columns(table, [d for d in found if d.format == table["format"]])
    others += [(d.name, [d]) for d in found if d.format != table["format"]]
    if any(members for _, members in columns):
        _remark_absent(result, columns)
    else:
        columns = []
        result.remarks.append("None of the paper's sequences is under the root: its figures are left out.")
    default = runner.defaults()["mode"]
    modes = ABLATION + [m for m in [default] if m not in ABLATION]
    jobs = [(f"{d.name} {mode}", (d, mode)) for d in found for mode in modes]

    def work(job):
        drive, mode = job
        bench = runner.bench(drive, mode, mode=mode)
        ate = _ate(bench["accuracy"])
        return (f"ATE {ate:.3f} m" if ate is not None else "no ground truth") + f", {bench['total']['mean']:.2f} ms", bench

    outcomes = dict(zip([job for _, job in jobs], _each(runner, "ablation", jobs, work)))

    def cell(members, mode):
        ates = [_ate(outcomes[d, mode]["accuracy"]) for d in members if outcomes[d, mode]]
        return _mean(ates) if ates else ("failed" if members else None)

    comparison = Table(f"{table['title']}: {table['unit']}", "Method", [c for c, _ in columns + others], rank=True,
                       digits=3)
    if columns:
        for row in table["rows"]:
            comparison.add(row["method"].replace(" (ours)", "") + " (paper)", row["values"] + [None] * len(others), 2)
        comparison.groups.append(len(comparison.rows))
    for mode in modes:
        label = f"{mode} (this run{', the default' if mode == default else ''})"
        comparison.add(label, [cell(members, mode) for _, members in columns + others])
    comparison.notes.append("The front-end alone, no loop closing. fixed_alpha: alpha 0.5; fixed_threshold: tau(n) "
                            "constant, as in GenZ-ICP.")
    if columns:
        comparison.notes.append(f"Paper's figures: {paper.source_text(data, table)}.")
    comparison.notes += result.remarks
    details = Table(f"{table['title']}: each drive", "Drive, mode",
                    ["scans", "ATE [m]", "KITTI drift [%]", "[deg/100 m]", "ms a scan, mean", "median", "p99",
                     "iterations", "degenerate", "lost"], digits=3)
    for (drive, mode), b in outcomes.items():
        kitti = (b["accuracy"] or {}).get("kitti", {}) if b else {}
        details.add(f"{drive.name}, {mode}", ["failed"] + [None] * 9 if b is None else [
            b["scans"], _ate(b["accuracy"]), kitti.get("t_percent"), kitti.get("r_deg_per_100m"), b["total"]["mean"],
            b["total"]["median"], b["total"]["p99"], b["iterations_per_scan"], b["degenerate"], b["lost"]])
    result.tables[name] = comparison
    result.tables[f"{name}_drives"] = details
    return result


# ---------------------------------------------------------------- runtime


# Settings whose figures differ by luck alone: their median is quoted.
EQUIVALENT = (26.98, 26.99, 27.0, 27.01, 27.02)  # n_ref


def leave_one_out(runner, name, found):
    """What each part of mode robust is worth: the front-end with all parts, and without each of them."""
    result = Result(name)
    parts = runner.robust_parts()
    jobs = [(f"{d.name} without {part or 'nothing'}", (d, part)) for d in found for part in [None, *parts]]

    def work(job):
        drive, part = job
        left_out = [f"frontend.robust.{part}=false"] if part else []
        runs = [runner.bench(drive, f"without_{part}_{n:g}", [f"frontend.n_ref={n:g}", *left_out], mode="robust")
                for n in EQUIVALENT]
        if any(r["accuracy"] is None for r in runs):
            raise RunFailed("the drive has no ground truth, so there is no ATE")
        figures = {"ate": statistics.median(_ate(r["accuracy"]) for r in runs),
                   "nees": statistics.median(r["normalised_error_squared"]["mean"] for r in runs),
                   "ms": statistics.median(r["total"]["mean"] for r in runs)}
        return f"ATE {figures['ate']:.3f} m", figures

    outcomes = dict(zip([job for _, job in jobs], _each(runner, "leave one out", jobs, work)))
    for key, unit in (("ate", "ATE [m]"), ("nees", "normalised error squared"), ("ms", "milliseconds per scan, mean")):
        table = Table(f"Leave one out: {unit}, medians of five equivalent settings", "Drive",
                      ["all parts", *(f"without {p}" for p in parts)], digits=3)
        ratios = {p: [] for p in parts}
        for drive in found:
            whole = outcomes[drive, None]
            table.add(drive.name, [outcomes[drive, p][key] if outcomes[drive, p] else None for p in [None, *parts]])
            for p in parts:
                if whole and outcomes[drive, p] and whole[key] > 0 and outcomes[drive, p][key] > 0:
                    ratios[p].append(outcomes[drive, p][key] / whole[key])
        table.add("geometric mean of the ratios", [1.0, *(statistics.geometric_mean(r) if r else None for r in ratios.values())])
        result.tables[f"{name}_{key}"] = table
    return result


def runtime(runner, data, name, found):
    """Milliseconds a scan by stage: the front-end's from hp2_bench, the back-end's from the four processes."""
    table = data["tables"][name]
    result = Result(name)

    def work(drive):
        bench, slam = runner.bench(drive, "runtime"), runner.slam(drive)
        stages = {stage: bench[stage]["mean"] for stage in STAGES}
        backend = slam["backend_ms"] or {"submaps": [], "finish": 0.0}
        stages["backend"] = (sum(backend["submaps"]) + backend["finish"]) / max(slam["poses_out"], 1)
        stages["total"] = bench["total"]["mean"] + stages["backend"]
        return f"{stages['total']:.2f} ms a scan", (stages, backend)

    outcomes = dict(zip(found, _each(runner, "runtime", [(d.name, d) for d in found], work)))
    ours_only = [s for s in STAGES if s not in {c["stage"] for c in table["columns"]}]
    columns = [c["stage"] for c in table["columns"][:-1]] + ours_only + ["total"]
    titles = {c["stage"]: c["name"] for c in table["columns"]} | {s: STAGES[s] for s in ours_only}
    breakdown = Table(f"{table['title']}: {table['unit']}", "Drive", [titles[c] for c in columns])

    def row_of_paper(row):
        values = dict(zip((c["stage"] for c in table["columns"]), row["values"]))
        breakdown.add(f"{row['method']} (paper)", [values.get(c) for c in columns])

    for drive, outcome in outcomes.items():
        if drive.format == table["format"]:
            for row in table["rows"]:
                if "drives" in row and drives_module.in_column(drive, row):
                    row_of_paper(row)
        breakdown.add(f"{drive.name} (this run)", ["failed"] + [None] * (len(columns) - 1) if outcome is None
                      else [outcome[0][c] for c in columns])
    good = [o[0] for o in outcomes.values() if o]
    breakdown.groups.append(len(breakdown.rows))
    row_of_paper(next(row for row in table["rows"] if row["method"] == "Average"))
    if good:
        breakdown.add("Average (this run)", [_mean([o[c] for o in good]) for c in columns])
    breakdown.notes = [
        f"Front-end: hp2_bench, {runner.threads} threads, wall time. Back-end: its whole time divided by the scans, "
        "while the four processes shared the machine; it works beside the front-end and delays no scan.",
        f"Paper's figures: {paper.source_text(data, table)}; measured there on an Intel i7, ours on this machine."]
    result.tables[name] = breakdown
    submaps = Table("Back-end: ms a submap", "Drive", ["submaps", "median", "worst", "finish"], digits=1)
    for drive, outcome in outcomes.items():
        if outcome and outcome[1]["submaps"]:
            ms = outcome[1]["submaps"]
            submaps.add(drive.name, [len(ms), float(statistics.median(ms)), max(ms), outcome[1]["finish"]])
    if submaps.rows:
        result.tables[f"{name}_backend"] = submaps
    return result


# ---------------------------------------------------------------- sensitivity


def sensitivity(runner, data, name, found, parameters=("tau_ref",)):
    """ATE of the front-end over a parameter of the planarity threshold."""
    table = data["tables"][name]
    result = Result(name)
    defaults = runner.defaults()
    for parameter in parameters:
        default = float(defaults[parameter])
        values = sorted(set(GRIDS[parameter]) | {default if default != int(default) else int(default)})
        low, high = table["stable_range"] if parameter == "tau_ref" else (values[0], values[-1])
        jobs = [(f"{d.name} {parameter}={v:g}", (d, v)) for d in found for v in values]

        def work(job):
            drive, value = job
            settings = [f"frontend.{parameter}={value:g}"]
            # The other bound follows where it would contradict this one.
            if parameter == "tau_min" and value > float(defaults["tau_max"]):
                settings.append(f"frontend.tau_max={value:g}")
            if parameter == "tau_max" and value < float(defaults["tau_min"]):
                settings.append(f"frontend.tau_min={value:g}")
            ate = _ate(runner.bench(drive, f"{parameter}_{value:g}", settings)["accuracy"])
            if ate is None:
                raise RunFailed("the drive has no ground truth, so there is no ATE")
            return f"ATE {ate:.3f} m", ate

        outcomes = dict(zip([job for _, job in jobs], _each(runner, "sensitivity", jobs, work)))
        change = f"change over [{low:g}, {high:g}]"
        curves = Table(f"Sensitivity to {parameter}: {table['unit']}", "Drive",
                       [f"{v:g}" + (" (default)" if v == default else "") for v in values] + [change], digits=3)
        lines, relative = [], []
        for drive in found:
            ates = [outcomes[drive, v] for v in values]
            inside = [a for v, a in zip(values, ates) if low <= v <= high and a is not None]
            spread = f"{100 * (max(inside) / min(inside) - 1):.1f} %" if inside and min(inside) > 0 else None
            curves.add(drive.name, ates + [spread])
            at_default = outcomes[drive, default]
            lines.append({"name": drive.name, "marker_px": 4, "points": [list(p) for p in zip(values, ates)]})
            if at_default:
                relative.append({"name": drive.name, "marker_px": 4,
                                 "points": [[v, a / at_default if a is not None else None]
                                            for v, a in zip(values, ates)]})
        curves.notes = [f"The front-end alone. Change: largest ATE over smallest, minus one, for {parameter} in "
                        f"[{low:g}, {high:g}]; the default is {default:g}.", *(
                            [f"The paper's claim: {paper.source_text(data, table)} and its sensitivity figure, which "
                             "gives no numbers."] if parameter == "tau_ref" else [])]
        stem = f"{name}_{parameter}"
        result.tables[stem] = curves
        common = {"x_label": parameter, "log_x": parameter in LOGARITHMIC, "y_from_zero": True, "height_px": 700}
        for description, part, shows in [
                ({"title": f"ATE over {parameter}", "y_label": "ATE RMSE [m]", "curves": lines}, stem, "ATE"),
                ({"title": f"ATE over {parameter}, relative to the default's ({default:g})",
                  "y_label": "ATE / ATE at the default", "curves": relative}, f"{stem}_relative", "relative ATE")]:
            try:
                pictures = runner.chart({**common, **description}, part)
                result.figures += [(p, f"{shows} over {parameter}") for p in pictures]
            except RunFailed as failure:
                runner.failures.append((f"figure {part}", str(failure)))
    return result
