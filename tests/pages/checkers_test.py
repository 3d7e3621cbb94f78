"""The scripts that check pages and comments find what they are for, and nothing else."""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "scripts"


def check(script, name, text, *options):
    """Exit status and output of a script on one file."""
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / name
        file.write_text(text)
        run = subprocess.run([sys.executable, "-B", str(SCRIPTS / script), *options, str(file)], capture_output=True, text=True)
        return run.returncode, run.stdout + run.stderr


LONG = "word " * 41 + "end."


class Language(unittest.TestCase):
    def test_FlagsLongSentenceInPage(self):
        self.assertEqual(check("check_language.py", "a.md", LONG)[0], 1)

    def test_FlagsLongSentenceOverSeveralCommentLines(self):
        lines = "\n".join("// " + "word " * 14 for _ in range(3))
        status, output = check("check_language.py", "a.cpp", lines + "\nint x;\n")
        self.assertEqual(status, 1)
        self.assertIn("a.cpp:1: a sentence of 42 words", output)

    def test_FlagsLongSentenceInPythonDocstringAndShell(self):
        self.assertEqual(check("check_language.py", "a.py", f'def f():\n    """{LONG}"""\n')[0], 1)
        self.assertEqual(check("check_language.py", "a.sh", f"# {LONG}\n")[0], 1)

    def test_AcceptsFortyWordsAndCodeBlocks(self):
        self.assertEqual(check("check_language.py", "a.md", "word " * 39 + "end.")[0], 0)
        self.assertEqual(check("check_language.py", "a.md", f"```\n{LONG}\n```\n")[0], 0)

    def test_CountsCellsAndItemsByThemselves(self):
        cell = "word " * 25
        self.assertEqual(check("check_language.py", "a.md", f"| {cell} | {cell} |\n\n- {cell}\n- {cell}\n")[0], 0)

    def test_LeavesStringsOfCodeAlone(self):
        self.assertEqual(check("check_language.py", "a.cpp", f'auto s = "http://x {LONG}";\n')[0], 0)

    def test_FlagsPrivateWords(self):
        for text in ("It takes 5 ms a scan.", "One pose a scan.", "It is found on the way back.", "A glimpse of the place.",
                     "The in-plane residual is heard."):
            self.assertEqual(check("check_language.py", "a.md", text)[0], 1, text)

    def test_AcceptsPlainWords(self):
        for text in ("It takes 5 ms per scan.", "A scan is a sweep.", "Start a session.", "On the way to a file."):
            self.assertEqual(check("check_language.py", "a.md", text), (0, "1 files, 0 remarks\n"), text)

    def test_TakesAnotherLimit(self):
        self.assertEqual(check("check_language.py", "a.md", "One two three four.", "--words", "3")[0], 1)


class Links(unittest.TestCase):
    def test_FlagsMissingFileAndHeading(self):
        status, output = check("check_links.py", "a.md", "# A b\n[x](missing.md) [y](#c) [z](a.md#a-c)\n")
        self.assertEqual(status, 1)
        self.assertEqual(output.count("a.md:2:"), 3)

    def test_AcceptsFilesHeadingsAndOtherSites(self):
        text = "# A `b`: c\n[x](a.md) [y](#a-b-c) [z](https://example.com/x#y)\n"
        self.assertEqual(check("check_links.py", "a.md", text)[0], 0)

    def test_LeavesCodeAlone(self):
        self.assertEqual(check("check_links.py", "a.md", "`[x](missing.md)`\n```\n[x](missing.md)\n```\n")[0], 0)

    def test_FlagsPicturesThatAreMissing(self):
        self.assertEqual(check("check_links.py", "a.md", '<img src="missing.png" width="4">\n')[0], 1)


@unittest.skipUnless(shutil.which("clang-tidy-14") and shutil.which("git"), "clang-tidy-14 or git is not installed")
class Tidy(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.root = pathlib.Path(temporary.name).resolve()
        (self.root / "scripts").mkdir()
        (self.root / "build").mkdir()
        shutil.copy(SCRIPTS / "check_style.sh", self.root / "scripts")
        shutil.copy(SCRIPTS.parent / ".clang-tidy", self.root)
        self.run_command("git", "init", "-q")

    def run_command(self, *command):
        environment = {**os.environ, "GIT_CONFIG_GLOBAL": "/dev/null"}
        return subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True)

    def commit(self, **sources):
        for name, text in sources.items():
            (self.root / f"{name}.cpp").write_text(text)
        files = [{"directory": str(self.root), "file": str(f), "command": f"c++ -std=c++17 -Winvalid-pch -include {self.root}/cmake_pch.hxx -c {f}"}
                 for f in self.root.glob("*.cpp")]
        (self.root / "build" / "compile_commands.json").write_text(json.dumps(files, indent=1))
        self.run_command("git", "add", "*.cpp")
        run = self.run_command("git", "-c", "user.name=a", "-c", "user.email=a@example.org", "commit", "-qm", "a")
        self.assertEqual(run.returncode, 0, run.stderr)

    def test_FlagsMistakeInTheLastCommitAndNotInEarlierOnes(self):
        self.commit(old="int* old() { return 0; }\n")
        self.commit(bad="int* bad() { return 0; }\n")
        run = self.run_command("scripts/check_style.sh", "tidy")
        self.assertEqual(run.returncode, 1, run.stdout + run.stderr)
        self.assertIn("bad.cpp:1:21: error: use nullptr", run.stdout)
        self.assertNotIn("old.cpp", run.stdout)
        self.assertIn("old.cpp:1:21: error: use nullptr", self.run_command("scripts/check_style.sh", "tidy", "--all").stdout)

    def test_AcceptsCleanSources(self):
        self.commit(first="int first() { return 1; }\n")
        self.commit(good="int* good() { return nullptr; }\n")
        run = self.run_command("scripts/check_style.sh", "tidy")
        self.assertEqual((run.returncode, run.stdout), (0, "clang-tidy: 1 sources, nothing found\n"), run.stderr)


if __name__ == "__main__":
    unittest.main()
