#!/usr/bin/env python3
"""Writes common/docs/configuration.md: every configuration key, from what the programs print with --print-config.

usage: scripts/config_reference.py [--build DIR] [--check]
--check changes nothing; it fails if the page is not what the programs print."""
import argparse
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGE = ROOT / "common" / "docs" / "configuration.md"
PROGRAMS = {
    "frontend": ("hp2_frontend", [], "frontend/frontend_config.hpp"),
    "backend": ("hp2_backend", ["--session", "none"], "backend/backend_config.hpp"),
    "viewer": ("hp2_viewer_headless", ["--out", "none"], "viewer_headless/write_session.hpp"),
}
HEAD = """# Configuration: every key

This page lists every key of the configuration file with its default. It is written by `scripts/config_reference.py` from what the
programs print with `--print-config`; do not edit it. How to use such a file: [common](../README.md#configuration).
"""
ENTRY = re.compile(r"^  # (?P<meaning>.*) \((?P<values>[^()]*)\)\n  (?P<key>[\w.]+): (?P<value>.*)$", re.MULTILINE)


def section(build, name):
    program, arguments, source = PROGRAMS[name]
    command = [str(build / "bin" / program), *arguments, "--print-config"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    entries = list(ENTRY.finditer(text))
    if not entries or len(entries) != len(re.findall(r"^  [^#]", text, re.MULTILINE)):
        raise SystemExit(f"config_reference.py: what {program} prints was not understood:\n{text}")
    cell = lambda words: words.replace("|", "\\|")
    rows = [f"| `{e['key']}` | `{e['value']}` | {cell(e['meaning'][0].upper() + e['meaning'][1:])} | {e['values']} |" for e in entries]
    return [f"\n## Section `{name}`", f"`{program}`; the struct is in [{source}](../../{source}).", "",
            "| key | default | meaning | values |", "|---|---|---|---|", *rows]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="build folder (default build)")
    parser.add_argument("--check", action="store_true", help="change nothing; fail if the page is not current")
    options = parser.parse_args()
    page = HEAD + "\n".join(line for name in PROGRAMS for line in section(options.build, name)) + "\n"
    if options.check:
        if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != page:
            sys.exit(f"{PAGE.relative_to(ROOT)} is not current. Write it anew: scripts/config_reference.py --build {options.build}")
        return
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page, encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)} written")


main()
