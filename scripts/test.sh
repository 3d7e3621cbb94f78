#!/usr/bin/env bash
# Builds and runs all tests.
#   scripts/test.sh              unit and integration tests (build/)
#   scripts/test.sh --sanitize   unit tests with address and undefined-behaviour sanitizers (build-asan/)
#   scripts/test.sh --tsan       unit and integration tests with the thread sanitizer (build-tsan/)
#   scripts/test.sh --all        the first and --sanitize: what CI runs
# More words go to ctest, e.g. scripts/test.sh -R transport
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

plain=1 sanitize=0 tsan=0
case ${1:-} in
  --sanitize) plain=0 sanitize=1 && shift ;;
  --tsan) plain=0 tsan=1 && shift ;;
  --all) sanitize=1 && shift ;;
  -h | --help) sed -n '2,7s/^# \{0,1\}//p' "$0" && exit 0 ;;
esac

# Unit tests run side by side; integration tests one at a time, they measure time and use every core.
run() { ctest --test-dir "$1" --output-on-failure --no-tests=error -j "$(nproc)" "${@:2}"; }

if [ "$sanitize" = 1 ]; then
  scripts/setup.sh --fuzz --build build-asan -DHP2_SANITIZE=address,undefined -DCMAKE_BUILD_TYPE=RelWithDebInfo
  UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 run build-asan -L "unit|fuzz" "$@"
fi
if [ "$tsan" = 1 ]; then
  scripts/setup.sh --build build-tsan -DHP2_SANITIZE=thread -DCMAKE_BUILD_TYPE=RelWithDebInfo
  TSAN_OPTIONS=halt_on_error=1:suppressions=$PWD/tests/tsan.supp run build-tsan "$@"
fi
if [ "$plain" = 1 ]; then
  scripts/setup.sh
  run build "$@"
fi
