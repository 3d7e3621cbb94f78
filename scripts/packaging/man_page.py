#!/usr/bin/env python3
"""Makes a man page of what a program says with --help.

usage: man_page.py NAME VERSION OUT.gz -- COMMAND...      runs COMMAND --help
"""
import gzip
import pathlib
import re
import subprocess
import sys


def roff(text):
    """Text that means itself."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"^([.'])", r"\\&\1", text, flags=re.M)


def page(name, version, text):
    """The page: the text's first line is the summary; sections are lines that end with a colon."""
    lines = text.strip().splitlines()
    if lines[0].lower().startswith("usage:") and len(lines) > 1:  # the summary comes second
        lines[0], lines[1] = lines[1], lines[0]
    summary = lines[0].rstrip(".")
    summary = summary[0].lower() + summary[1:]
    out = [f'.TH {name.upper()} 1 "" "HP2\\-SLAM {version}" "HP2\\-SLAM"', ".SH NAME", f"{name} \\- {roff(summary)}"]
    verbatim = False

    def keep(on):
        nonlocal verbatim
        if on != verbatim:
            out.append(".nf" if on else ".fi")
            verbatim = on

    section = "DESCRIPTION"
    shown = None
    for line in lines[1:]:
        usage = re.match(r"[Uu]sage: *(.*)", line)
        heading = re.fullmatch(r"([A-Z][A-Za-z ]+):", line)
        option = re.match(r"  (-{1,2}\S.*?|[A-Z]+\b.*?)(?: {2,}(\S.*))?$", line)
        if usage:
            keep(False)
            out += [".SH SYNOPSIS", f".B {roff(usage.group(1))}"]
            shown = "SYNOPSIS"
            continue
        if not line.strip():
            keep(False)
            continue
        if heading:
            keep(False)
            section = {"Positionals": "ARGUMENTS"}.get(heading.group(1), heading.group(1).upper())
            out.append(f".SH {section}")
            shown = section
            continue
        if section in ("OPTIONS", "ARGUMENTS", "COMMON") and option:
            keep(False)
            out += [".TP", f".B {roff(option.group(1))}"]
            if option.group(2):
                out.append(roff(option.group(2)))
            continue
        if section in ("OPTIONS", "ARGUMENTS", "COMMON") and line.startswith("      "):
            out.append(roff(line.strip()))
            continue
        if shown != section and section == "DESCRIPTION":
            out.append(".SH DESCRIPTION")
            shown = section
        keep(line.startswith("  "))
        if not verbatim and section != "DESCRIPTION":
            out.append(".PP")
        out.append(roff(line))
    keep(False)
    out += [".SH SEE ALSO", ".BR hp2\\-slam (1)" if name != "hp2-slam" else "Each program's own page, for instance\n.BR hp2_frontend (1)"]
    return "\n".join(out) + "\n"


def main():
    if len(sys.argv) < 6:
        print(__doc__)
        return 2
    name, version, out = sys.argv[1:4]
    run = subprocess.run([*sys.argv[5:], "--help"], capture_output=True, text=True)
    if run.returncode != 0 or not run.stdout.strip():
        print(f"man_page.py: {' '.join(sys.argv[5:])} --help failed: {run.stderr.strip()}", file=sys.stderr)
        return 1
    text = run.stdout
    pathlib.Path(out).parent.mkdir(parents=True, exist_ok=True)
    with open(out, "wb") as raw, gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0, compresslevel=9) as file:
        file.write(page(name, version, text).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
