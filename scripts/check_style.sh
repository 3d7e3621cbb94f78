#!/usr/bin/env bash
# Checks the formatting of the C++ sources (clang-format-14), the shell scripts (shellcheck), or the C++ sources for
# mistakes (clang-tidy-14, .clang-tidy; some 10 s per file, without tests/).
#   scripts/check_style.sh format|shell
#   scripts/check_style.sh tidy [--all | --since COMMIT] [--build DIR]
# tidy looks at the sources that changed since COMMIT (default: the last commit and what is not committed), at most 12 of them,
# or at --all of them. DIR (default build) must have been configured.
# Exit status: 0 all is well; 1 something is not; 77 the tool is not installed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

most=12  # sources per tidy unless --all: a minute or two on two cores
files() { git ls-files -co --exclude-standard "$@" 2>/dev/null || find . -path ./.git -prune -o -path './build*' -prune -o -name "$1" -print; }

# Sources (.cpp) that changed since commit $1; of a changed header the source of the same name.
changed() {
  { git diff --name-only "$1" -- '*.cpp' '*.hpp' && git ls-files -o --exclude-standard '*.cpp' '*.hpp'; } |
    sed 's/\.hpp$/.cpp/' | sort -u | while read -r file; do [ ! -e "$file" ] || echo "$file"; done
}

tidy() {
  local since=HEAD~1 build=build all=0
  while [ $# -gt 0 ]; do
    case $1 in
      --all) all=1 && shift ;;
      --since) since=${2:?--since needs a commit} && shift 2 ;;
      --build) build=${2:?--build needs a folder} && shift 2 ;;
      *) echo "check_style.sh: unknown option $1" >&2 && exit 2 ;;
    esac
  done
  command -v clang-tidy-14 >/dev/null || { echo "skipped: clang-tidy-14 is not installed" && exit 77; }
  local commands=$build/compile_commands.json sources
  [ -e "$commands" ] || { echo "check_style.sh: $commands is not there. Configure first: scripts/setup.sh --build $build" >&2 && exit 2; }
  if [ "$all" = 1 ]; then
    sources=$(files '*.cpp')
  else
    git rev-parse -q --verify "$since^{commit}" >/dev/null || { echo "skipped: there is no commit $since to compare with" && exit 77; }
    sources=$(changed "$since")
  fi
  # Those that this build compiles. The compiler's precompiled headers are not clang's.
  mkdir -p "$build/tidy"
  sed -E 's/ -Winvalid-pch//; s/ -include [^ ]*cmake_pch\.hxx//' "$commands" >"$build/tidy/compile_commands.json"
  sources=$(for file in $sources; do
    case ${file#./} in tests/*) continue ;; esac
    if grep -qF "$PWD/${file#./}\"" "$commands"; then echo "$file"; fi
  done)
  if [ "$all" = 0 ] && [ "$(wc -l <<<"$sources")" -gt "$most" ]; then
    echo "left out: $(tail -n "+$((most + 1))" <<<"$sources" | tr '\n' ' ')"
    sources=$(head -n "$most" <<<"$sources")
  fi
  [ -n "$sources" ] || { echo "no source has changed since $since" && return; }
  xargs -P "$(nproc)" -n 1 clang-tidy-14 -p "$build/tidy" --quiet --extra-arg=-Wno-unknown-warning-option <<<"$sources" \
    2> >(grep -v 'warnings\? generated' >&2) || return 1
  echo "clang-tidy: $(wc -l <<<"$sources") sources, nothing found"
}

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
  tidy) tidy "${@:2}" ;;
  -h | --help) sed -n '2,8s/^# \{0,1\}//p' "$0" ;;
  *) echo "check_style.sh: give format, shell or tidy" >&2 && exit 2 ;;
esac
