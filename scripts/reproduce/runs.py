"""Runs the project's programs on drives, each once: what is there already from the same command is taken as it is."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

SCRIPTS = pathlib.Path(__file__).resolve().parents[1]


class RunFailed(Exception):
    """A program ended with an error; the text says which, its last words and where the log is."""


class Runner:
    """Where the programs are, where results go, and what every run is given."""

    def __init__(self, build, out, threads=2, config=None, mode=None, first=0, count=0, again=False):
        self.build = pathlib.Path(build).resolve()
        self.bin = self.build / "bin"
        self.out = pathlib.Path(out).resolve()
        self.threads = threads
        self.config = str(pathlib.Path(config).resolve()) if config else None
        self.mode = mode
        self.selection = (["--first", str(first)] if first else []) + (["--count", str(count)] if count else [])
        self.again = again
        self.failures = []  # (what, why)
        self.label = ""
        self._last_shown = 0.0

    # ------------------------------------------------------------ what a user sees

    def say(self, text):
        self._clear()
        print(text, flush=True)

    def begin(self):
        """A terminal shows what is being worked on from the first moment."""
        self._last_shown = time.monotonic()
        if sys.stdout.isatty():
            print(f"\r\033[K{self.label} ...", end="", flush=True)

    def _clear(self):
        if sys.stdout.isatty():
            print("\r\033[K", end="")

    def _show(self, text):
        """A sign of life: on a terminal the present line, in a log one line a minute."""
        now = time.monotonic()
        if sys.stdout.isatty():
            width = shutil.get_terminal_size().columns - 1
            print(f"\r\033[K{self.label}: {text}"[: width + 4], end="", flush=True)
        elif now - self._last_shown > 60:
            print(f"{self.label}: {text}", flush=True)
        else:
            return
        self._last_shown = now

    # ------------------------------------------------------------ programs

    def _versions(self):
        """What tells one build's results from another's."""
        programs = ["hp2_player", "hp2_frontend", "hp2_backend", "hp2_bench"]
        return {p: [s.st_size, s.st_mtime_ns] for p in programs if (s := (self.bin / p).stat())}

    def _stamp(self, command):
        settings = pathlib.Path(self.config).read_text() if self.config else ""
        return {"command": command[1:], "configuration": settings, "programs": self._versions()}

    def _run(self, command, log):
        """Runs it with all it says in `log`; raises RunFailed."""
        self._last_shown = time.monotonic()
        log.parent.mkdir(parents=True, exist_ok=True)
        words = []
        with open(log, "w", encoding="utf-8", errors="replace") as file:
            # A session of its own: Ctrl-C reaches this program alone, which passes it on once.
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                       errors="replace", bufsize=1, start_new_session=True)
            try:
                for line in process.stdout:
                    file.write(line)
                    words = (words + [line.strip()])[-20:]
                    if "scans/s" in line:
                        self._show(line.strip())
                status = process.wait()
            except KeyboardInterrupt:
                process.send_signal(signal.SIGINT)
                try:
                    process.wait()  # it stores what it has
                except KeyboardInterrupt:  # again: at once
                    process.send_signal(signal.SIGINT)
                    process.wait()
                raise
        if status != 0:
            name = pathlib.Path(command[0]).name
            errors = ([w for w in words if "error" in w.lower()] or [w for w in words if w.startswith(f"{name}:")] or
                      [w for w in words if w] or ["it said nothing"])
            raise RunFailed(f"{name} ended with status {status}: {errors[-1]} (log: {log})")

    def slam(self, drive):
        """The drive through all four processes; its summary.json, and `folder` where the rest lies."""
        folder = self.out / "runs" / f"slam_{drive.name}"
        command = [str(SCRIPTS / "run_slam.sh"), drive.path, "--out", str(folder), "--build", str(self.build),
                   "--threads", str(self.threads), *self.selection]
        command += ["--config", self.config] if self.config else []
        command += ["--mode", self.mode] if self.mode else []
        stamp, stamp_file = self._stamp(command), folder / "run.json"
        before = _read_json(stamp_file)
        if before is not None and (before != stamp or self.again):
            shutil.rmtree(folder)  # ours (it has the stamp), made by another command or build
            before = None
        summary = _read_json(folder / "summary.json")
        reused = before is not None and summary is not None and summary.get("complete")
        if not reused:
            folder.mkdir(parents=True, exist_ok=True)
            stamp_file.write_text(json.dumps(stamp, indent=1))
            # After Ctrl-C a session is closed with what it has: begun anew, whatever is there.
            anew = ["--overwrite"] if (folder / "session").exists() else []
            self._run(command + anew, folder / "run_slam.log")
            summary = _read_json(folder / "summary.json")
            if summary is None:
                raise RunFailed(f"{folder / 'summary.json'} was not written (log: {folder / 'run_slam.log'})")
        return {**summary, "folder": folder, "reused": bool(reused), "backend_ms": backend_milliseconds(folder)}

    def bench(self, drive, label, settings=(), mode=None):
        """The front-end alone; hp2_bench's JSON. `settings`: "section.key=value"."""
        folder = self.out / "runs" / f"bench_{drive.name}"
        report = folder / f"{label}.json"
        command = [str(self.bin / "hp2_bench"), drive.path, "--threads", str(self.threads), *self.selection,
                   "--json", str(report), "--out", str(folder / f"{label}.txt")]
        command += ["--config", self.config] if self.config else []
        mode = mode or self.mode
        command += ["--mode", mode] if mode else []
        for setting in settings:
            command += ["--set", setting]
        stamp, stamp_file = self._stamp(command), folder / f"{label}.run.json"
        result = _read_json(report)
        if self.again or result is None or _read_json(stamp_file) != stamp:
            report.unlink(missing_ok=True)
            self._run(command, folder / f"{label}.log")
            result = _read_json(report)
            if result is None:
                raise RunFailed(f"{report} was not written")
            stamp_file.write_text(json.dumps(stamp, indent=1))
        return result

    def defaults(self):
        """The front-end's settings in use: key -> text."""
        command = [str(self.bin / "hp2_frontend"), "--print-config"] + (["--config", self.config] if self.config else [])
        command += ["--mode", self.mode] if self.mode else []
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise RunFailed(done.stderr.strip() or "hp2_frontend --print-config failed")
        return dict(re.findall(r"^  (\w+): (.*)$", done.stdout, re.MULTILINE))

    def robust_parts(self):
        """Names of the parts of mode robust that can be left out."""
        done = subprocess.run([str(self.bin / "hp2_frontend"), "--print-config"], capture_output=True, text=True)
        return re.findall(r"^  robust\.(\w+): ", done.stdout, re.MULTILINE)

    # ------------------------------------------------------------ figures

    def trajectory_figures(self, drive, folder, stem):
        """Trajectories and error along the path against ground truth, PNG and SVG; the pictures' names."""
        figures = self.out / "figures"
        figures.mkdir(parents=True, exist_ok=True)
        truth = folder / "ground_truth_tum.txt"
        made = [f"{stem}_{kind}.{end}" for kind in ("trajectory", "errors") for end in ("png", "svg")]
        log = folder / "figures.log"
        self._run([str(self.bin / "hp2_player"), drive.path, *self.selection, "--write-ground-truth", str(truth)], log)
        command = [str(self.bin / "hp2_eval"), str(truth), str(folder / "poses_tum.txt"),
                   str(folder / "poses_odometry_tum.txt"), "--names", "HP2-SLAM,odometry alone", "--csv",
                   str(folder / "scores.csv")]
        for name in made:
            command += ["--plot" if "_trajectory." in name else "--plot-errors", str(figures / name)]
        self._run(command, log)
        return made

    def chart(self, description, stem):
        """A chart as PNG and SVG; their names."""
        figures = self.out / "figures"
        figures.mkdir(parents=True, exist_ok=True)
        source = figures / f"{stem}.json"
        source.write_text(json.dumps(description, indent=1))
        names = [f"{stem}.png", f"{stem}.svg"]
        self._run([str(self.bin / "hp2_chart"), str(source), *(str(figures / n) for n in names)],
                  self.out / "runs" / "figures.log")
        return names


def backend_milliseconds(folder):
    """What the back-end's log says of its time: {"submaps": [ms, ...], "finish": ms}; None without a log."""
    try:
        log = (folder / "logs" / "backend.log").read_text(errors="replace")
    except OSError:
        return None
    submaps = [float(ms) for ms in re.findall(r"submap \d+: .*?([\d.]+) ms$", log, re.MULTILINE)]
    finish = re.findall(r"session finished in ([\d.]+) ms", log)
    return {"submaps": submaps, "finish": float(finish[-1]) if finish else 0.0}


def _read_json(path):
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (OSError, ValueError):
        return None
