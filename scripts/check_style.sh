#!/usr/bin/env bash
# Checks the formatting of the C++ sources (clang-format-14) or the shell scripts (shellcheck).
#   scripts/check_style.sh format|shell
# Exit status: 0 all is well; 1 something is not; 77 the tool is not installed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

files() { git ls-files -co --exclude-standard "$@" 2>/dev/null || find . -path ./.git -prune -o -path './build*' -prune -o -name "$1" -print; }
case ${1:-} in
  format)
    command -v clang-format-14 >/dev/null || { echo "skipped: clang-format-14 is not installed" && exit 77; }
    files '*.cpp' '*.hpp' | xargs clang-format-14 --dry-run --Werror || {
      echo "Format them with: clang-format-14 -i FILE" >&2
      exit 1
    }
    ;;
  shell)
    command -v shellcheck >/dev/null || { echo "skipped: shellcheck is not installed" && exit 77; }
    { files '*.sh' && echo scripts/hp2-slam scripts/packaging/completion.bash; } | xargs shellcheck -x
    ;;
  -h | --help) sed -n '2,4s/^# \{0,1\}//p' "$0" ;;
  *) echo "check_style.sh: give format or shell" >&2 && exit 2 ;;
esac
