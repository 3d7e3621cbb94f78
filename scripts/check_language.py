#!/usr/bin/env python3
"""Flags sentences of more than 40 words, and words that only this project's authors would understand.

usage: scripts/check_language.py [--words N] [FILE ...]      (default: all pages and sources of the repository)

Looks at Markdown pages and at the comments of C++, Python, shell, CMake, JavaScript and LCM files. Code, formulas, links'
addresses and tables of numbers do not count. A cell of a table and an item of a list are sentences of their own.
A page that quotes what it must not say can exempt a line with <!-- language: quoted -->.
Exit status: 0 nothing is flagged; 1 something is; 2 wrong command line.
"""
import io
import pathlib
import re
import subprocess
import sys
import tokenize

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOST_WORDS = 40
UNITS = r"(?:ms|us|MB|kB|GB|bytes|points|poses?|one|once|two|three|lines?|twice)"
THINGS = r"(?:scan|submap|sweep|voxel|file|line|point|message|metre|session|type|piece|process|row|stage)"
PRIVATE = [  # (what is flagged, what to write)
    (rf"\b{UNITS} an? {THINGS}\b", "per scan, per submap, ..."),
    (r"\b(?:one|a|single) (?:transaction|query|thread|test|port|state) a (?:scan|submap|session|run)\b", "per submap, ..."),
    (r"\bthe way back\b", "backward pass"),
    (r"\b(?:two|the) ways are\b|\bways? of the scans\b", "trajectory"),
    (r"\b(?:told|said) (?:anew|again|once more)\b", "re-estimated, reported again"),
    (r"\bheard\b", "used"),
    (r"\bexplains? (?:it )?as (?:much|well)\b", "equally likely"),
    (r"\bseen? hardly\b|\bhardly (?:seen|sees|saw)\b|\bsaw some direction hardly\b", "weakly observable"),
    (r"\bmade (?:drive|world|data set)s?\b", "synthetic drive, synthetic world"),
    (r"\bwhoever is (?:ahead|behind)\b", "upstream of, downstream of"),
    (r"\bglimpses?\b", "partial overlap"),
    (r"\b(?:a|doubtful|such a) start(?:'s)?(?= (?:is|are|was|of|that|search)\b|[,.;:)]|$)", "initialisation; the first 16 scans"),
]
PRIVATE = [(re.compile(pattern, re.IGNORECASE), word) for pattern, word in PRIVATE]
SLASH = {".cpp", ".hpp", ".h", ".lcm", ".js", ".css"}
HASH = {".sh", ".cmake", ".yaml", ".yml", ".toml"}


def tracked():
    """Files that git knows, or would add."""
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard"], capture_output=True, text=True)
    if listed.returncode == 0:
        return [ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file()]
    return sorted(p for p in ROOT.rglob("*") if p.is_file() and not p.relative_to(ROOT).parts[0].startswith((".", "build")))


def plain(text):
    """Text as it is read: code and formulas are one word, a link is its text."""
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]+\$", " X ", text)
    text = re.sub(r"``?[^`]+``?", " X ", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"<[^>\s][^>]*>", " ", text)
    return re.sub(r"[*_|]{1,3}", " ", text)


def sentences(text):
    """Sentences of a paragraph. Abbreviations and decimal points do not end one."""
    text = re.sub(r"\b(e\.g|i\.e|etc|eq|cf|vs|approx|Fig|Eq)\.", r"\1", text)
    return [s for s in re.split(r"(?<=[.!?])[)\"']*\s+(?=\S)|(?<=[:;])\s*\n\s*[-*] ", text) if s.strip()]


def count_words(sentence):
    """Words with a letter in them: numbers and signs are not read aloud."""
    return sum(1 for w in sentence.split() if re.search(r"[A-Za-z]", w))


def page_paragraphs(text):
    """(line, text) of each paragraph, list item and table cell of a Markdown page."""
    fence, start, parts = False, 0, []

    def end():
        nonlocal parts
        if parts:
            yield start, " ".join(parts)
        parts = []

    for number, line in enumerate(text.splitlines(), 1):
        if re.match(r"\s*(```|~~~)", line):
            fence = not fence
            yield from end()
            continue
        if fence or "<!-- language: quoted -->" in line:
            continue
        stripped = line.strip()
        if not stripped or stripped.startswith(("#", "$$")) or (line.startswith("    ") and not parts):
            yield from end()
            continue
        if stripped.startswith("|"):
            yield from end()
            for cell in re.split(r"(?<!\\)\|", stripped.strip("|")):
                yield number, cell
            continue
        if re.match(r"([-*+]|\d+\.)\s", stripped):
            yield from end()
            stripped = re.sub(r"^([-*+]|\d+\.)\s+", "", stripped)
        if not parts:
            start = number
        parts.append(stripped)
    yield from end()


def comment_lines(path, text):
    """(line number, comment text, stands alone) of each comment of a source file."""
    if path.suffix == ".py":
        try:
            for token in tokenize.generate_tokens(io.StringIO(text).readline):
                if token.type == tokenize.COMMENT:
                    yield token.start[0], token.string.lstrip("#! "), token.line.strip().startswith("#")
                elif token.type == tokenize.STRING and token.line.lstrip().startswith(('"""', "'''", 'r"""')):
                    for i, line in enumerate(token.string.strip("r\"'").splitlines()):
                        yield token.start[0] + i, line.strip(), True
        except (tokenize.TokenError, IndentationError, SyntaxError):
            return
        return
    block = False
    for number, line in enumerate(text.splitlines(), 1):
        if path.suffix in SLASH:
            if block:
                yield number, line.replace("*/", "").strip(" *"), True
                block = "*/" not in line
                continue
            bare = re.sub(r'"(?:\\.|[^"\\])*"', lambda m: "_" * len(m.group()), line)
            at = bare.find("//")
            if at >= 0 and bare[at - 1:at] != ":":
                yield number, line[at:].lstrip("/<! "), not line[:at].strip()
            elif "/*" in bare:
                yield number, line[bare.index("/*") + 2:].replace("*/", "").strip(" *"), True
                block = "*/" not in bare
        else:
            match = re.match(r"(\s*)#(?!!)\s?(.*)", line)
            if match:
                yield number, match.group(2).strip(), True


def source_paragraphs(path, text):
    """(line, text) of each comment; comments on consecutive lines are one."""
    start, last, parts = 0, -2, []
    for number, comment, alone in comment_lines(path, text):
        begins = not alone or number != last + 1 or not comment or re.match(r"(@\w+|[-*] |\d+\. )|.*\S {2,}\S", comment)
        if begins and parts:
            yield start, "\n".join(parts)
            parts = []
        if comment and not re.match(r"(clang-format|NOLINT|shellcheck)", comment):
            if not parts:
                start = number
            parts.append(re.sub(r"^(@param \w+|@\w+|[-*] )\s*", "", comment))
        last = number if alone else -2
    if parts:
        yield start, "\n".join(parts)


def remarks(path, most_words):
    """Messages on one file."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return
    if path.suffix == ".md":
        paragraphs = page_paragraphs(text)
    elif path.suffix in SLASH | HASH | {".py"} or path.name == "CMakeLists.txt" or text.startswith("#!/bin/sh"):
        paragraphs = source_paragraphs(path, text)
    else:
        return
    name = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    for line, paragraph in paragraphs:
        paragraph = plain(paragraph)
        for sentence in sentences(paragraph):
            words = count_words(sentence)
            if words > most_words:
                yield f"{name}:{line}: a sentence of {words} words: {' '.join(sentence.split()[:8])} ..."
        for pattern, word in PRIVATE:
            for match in pattern.finditer(" ".join(paragraph.split())):
                yield f"{name}:{line}: \"{match.group()}\"; write: {word}"


def main():
    arguments, most_words = sys.argv[1:], MOST_WORDS
    if "-h" in arguments or "--help" in arguments:
        print(__doc__)
        return 0
    if arguments[:1] == ["--words"]:
        if len(arguments) < 2 or not arguments[1].isdigit():
            print("check_language.py: --words needs a number", file=sys.stderr)
            return 2
        most_words, arguments = int(arguments[1]), arguments[2:]
    files = [pathlib.Path(a).resolve() for a in arguments]
    for file in files:
        if not file.is_file():
            print(f"check_language.py: there is no file {file}", file=sys.stderr)
            return 2
    if not files:
        files = tracked()
    messages = [m for file in files if file != pathlib.Path(__file__).resolve() for m in remarks(file, most_words)]
    for message in messages:
        print(message)
    print(f"{len(files)} files, {len(messages)} remarks")
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main())
