#!/usr/bin/env bash
# Builds and runs the tests.
#   scripts/test.sh              unit and integration tests (build/)
#   scripts/test.sh --sanitize   unit tests with address and undefined-behaviour sanitizers (build-asan/)
#   scripts/test.sh --long       the integration tests that take minutes each: restarts, losses, two hosts, overload, hostile input
#   scripts/test.sh --all        the first, and the sanitizers over common and player: what CI runs
# More words go to ctest, e.g. scripts/test.sh -R transport
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

plain=1 long=0 sanitized=()
unit_programs=(common_tests player_tests frontend_tests backend_tests transport_tests evaluation_tests viewer_headless_tests)
case ${1:-} in
  --sanitize) plain=0 sanitized=("${unit_programs[@]}") && shift ;;
  --long) plain=0 long=1 && shift ;;
  --all) sanitized=(common_tests player_tests) && shift ;;
  -h | --help) sed -n '2,8s/^# \{0,1\}//p' "$0" && exit 0 ;;
esac

run() { ctest --test-dir "$1" --output-on-failure --no-tests=error "${@:2}"; }

if [ ${#sanitized[@]} -gt 0 ]; then
  scripts/setup.sh --build build-asan --targets "${sanitized[*]}" -DHP2_SANITIZE=address,undefined \
    -DCMAKE_BUILD_TYPE=RelWithDebInfo
  for program in "${sanitized[@]}"; do
    UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 run build-asan -L unit -R "^${program%_tests}[.]" -j "$(nproc)" "$@"
  done
fi
if [ "$plain" = 1 ] || [ "$long" = 1 ]; then
  scripts/setup.sh
fi
if [ "$long" = 1 ]; then run build -L long "$@"; fi
if [ "$plain" = 1 ]; then
  # Unit tests side by side; integration tests one at a time, they measure time and use both cores.
  run build -L unit -j "$(nproc)" "$@"
  run build -L integration "$@"
fi
