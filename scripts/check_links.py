#!/usr/bin/env python3
"""Checks the links of the Markdown pages: each file must exist, each #anchor must be a heading of its page.

usage: scripts/check_links.py [PAGE.md ...]      (default: all pages of the repository)

Links to other sites are not followed. Exit status: 0 all links lead somewhere; 1 some do not; 2 wrong command line.
"""
import pathlib
import re
import subprocess
import sys
import urllib.parse

ROOT = pathlib.Path(__file__).resolve().parent.parent
LINK = re.compile(r'!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+"[^"]*")?\s*\)|<(?:img|a)\s[^>]*?(?:src|href)="([^"]+)"')


def pages():
    """Markdown files that git knows, or would add."""
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard", "*.md"],
                            capture_output=True, text=True)
    if listed.returncode == 0:
        return [ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file()]
    return sorted(p for p in ROOT.rglob("*.md") if not p.relative_to(ROOT).parts[0].startswith("build"))


def lines_outside_code(text):
    """(line number, line) of a page without code blocks and inline code."""
    fence = None
    for number, line in enumerate(text.splitlines(), 1):
        mark = re.match(r"\s*(```|~~~)", line)
        if mark and fence in (None, mark.group(1)):
            fence = None if fence else mark.group(1)
            continue
        if fence is None:
            yield number, re.sub(r"`[^`]*`", lambda m: "`" + " " * (len(m.group()) - 2) + "`", line)


def slug(heading):
    """Anchor that GitHub and GitLab make of a heading."""
    heading = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading.strip()).lower()
    return re.sub(r"[^\w\- ]", "", heading).replace(" ", "-")


def anchors(page):
    """All anchors of a page."""
    found, seen = set(), {}
    fence = False
    for line in page.read_text(encoding="utf-8").splitlines():
        if re.match(r"\s*(```|~~~)", line):
            fence = not fence
        if fence:
            continue
        heading = re.match(r"#{1,6}\s+(.*?)\s*#*$", line)
        if heading:
            name = slug(heading.group(1))
            count = seen.get(name, 0)
            seen[name] = count + 1
            found.add(name if count == 0 else f"{name}-{count}")
        found.update(re.findall(r'<a\s+(?:id|name)="([^"]+)"', line))
    return found


def broken_links(page):
    """Messages on the links of a page that lead nowhere."""
    for number, line in lines_outside_code(page.read_text(encoding="utf-8")):
        for match in LINK.finditer(line):
            target = match.group(1) or match.group(2)
            if re.match(r"[a-z][a-z0-9+.-]*:", target, re.IGNORECASE):
                continue
            path, _, anchor = target.partition("#")
            file = (page.parent / urllib.parse.unquote(path)).resolve() if path else page
            where = f"{page.relative_to(ROOT) if page.is_relative_to(ROOT) else page}:{number}"
            if not file.exists():
                yield f"{where}: there is no file {target}"
            elif not file.is_relative_to(ROOT) and page.is_relative_to(ROOT):
                yield f"{where}: {target} leads out of the repository"
            elif anchor and file.suffix == ".md" and anchor not in anchors(file):
                yield f"{where}: {path or 'this page'} has no heading for #{anchor}"


def main():
    if any(a in ("-h", "--help") for a in sys.argv[1:]):
        print(__doc__)
        return 0
    chosen = [pathlib.Path(a).resolve() for a in sys.argv[1:]] or pages()
    for page in chosen:
        if not page.is_file():
            print(f"check_links.py: there is no page {page}", file=sys.stderr)
            return 2
    messages = [m for page in chosen for m in broken_links(page)]
    for message in messages:
        print(message)
    print(f"{len(chosen)} pages, {len(messages)} broken links")
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main())
