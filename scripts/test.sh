#!/usr/bin/env bash
# Builds and runs the tests.
#   scripts/test.sh              unit and integration tests (build/)
#   scripts/test.sh --sanitize   unit tests with address and undefined-behaviour sanitizers (build-asan/)
#   scripts/test.sh --fuzz       fuzz targets, HP2_FUZZ_SECONDS (60) each, two at a time (build-asan/; needs clang)
#   scripts/test.sh --tsan       unit and integration tests with the thread sanitizer (build-tsan/); takes an hour
#   scripts/test.sh --long       integration tests that take minutes each: two hosts, overload, hostile input, faults of the disk
#   scripts/test.sh --all        the first three: what CI runs
# More words go to ctest, e.g. scripts/test.sh -R transport; at least one test must fit them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

what=plain
case ${1:-} in
  --sanitize | --fuzz | --tsan | --long | --all) what=${1#--} && shift ;;
  -h | --help) sed -n '2,9s/^# \{0,1\}//p' "$0" && exit 0 ;;
esac
unit_programs="common_tests transport_tests evaluation_tests player_tests frontend_tests backend_tests viewer_headless_tests"
processes="hp2_player hp2_frontend hp2_backend hp2_viewer_headless hp2_control hp2_injector hp2_eval
  hp2_lossy_relay hp2_hostile hp2_bad_frontend hp2_write_dataset hp2_chart hp2_bench hp2_calibrate"
fuzz_targets="messages point_files logs bags packets ros_messages trajectories"
# Without -g and with few optimisations a sanitizer build takes as long as a plain one.
sanitizer_options=(-DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS=-O1)
words=("$@") prefix=()

run() {
  ${prefix[@]+"${prefix[@]}"} ctest --test-dir "$1" --output-on-failure --no-tests=error "${@:2}" ${words[@]+"${words[@]}"}
}

timed() {
  local since=$SECONDS
  "${@:2}"
  echo "== $1: $((SECONDS - since)) s"
}

plain() {
  timed "plain build" scripts/setup.sh -DHP2_WITH_PYTHON=ON
  if [ ${#words[@]} -gt 0 ]; then  # which of both kinds they name is not known
    timed "tests" run build -L '^(unit|integration)$' -j "$(nproc)"
    return
  fi
  # Unit tests side by side; integration tests one at a time, they measure time and use both cores.
  timed "unit tests" run build -L unit -j "$(nproc)"
  timed "integration tests" run build -L integration
}

long() {
  timed "plain build" scripts/setup.sh
  export HP2_DISK_FAULTS_EVERY=1 HP2_LIVE_SECONDS=600  # all of them, and ten minutes
  timed "long integration tests" run build -L long
}

# sanitize PROGRAMS
sanitize() {
  local tests=${1//_tests/}
  timed "sanitizer build" scripts/setup.sh --build build-asan --targets "$1" -DHP2_SANITIZE=address,undefined \
    "${sanitizer_options[@]}"
  UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 ASAN_OPTIONS=detect_stack_use_after_return=1 \
    timed "unit tests with sanitizers" run build-asan -L unit -R "^(${tests// /|})[.]" -j "$(nproc)"
}

tsan() {
  # It dies at the start where the kernel spreads a program's memory further than it knows (vm.mmap_rnd_bits above 28).
  if setarch "$(uname -m)" -R true 2>/dev/null; then prefix=(setarch "$(uname -m)" -R); fi
  timed "thread sanitizer build" ${prefix[@]+"${prefix[@]}"} scripts/setup.sh --build build-tsan \
    --targets "$unit_programs $processes" -DHP2_SANITIZE=thread "${sanitizer_options[@]}"
  export HP2_REAL_DRIVES=kitti_0926_0002  # the shortest
  export TSAN_OPTIONS="suppressions=$PWD/tests/tsan.supp:halt_on_error=0:exitcode=66:second_deadlock_stack=1"
  timed "unit tests with the thread sanitizer" run build-tsan -L unit -j "$(nproc)"
  timed "integration tests with the thread sanitizer" run build-tsan -L integration
}

fuzz_one() {
  local folder=build-asan/fuzz/$1
  mkdir -p "$folder/corpus"
  ASAN_OPTIONS=allocator_may_return_null=0 UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 \
    "build-asan/bin/hp2_fuzz_$1" -max_total_time="${HP2_FUZZ_SECONDS:-60}" -max_len=20000 -timeout=10 -rss_limit_mb=2048 \
    -print_final_stats=1 -artifact_prefix="$folder/" "$folder/corpus" "tests/fuzz/seeds/$1" >"$folder/log" 2>&1 && return
  tail -n 40 "$folder/log"
  echo "fuzz target $1 failed; the input is in $folder/"
  return 1
}

fuzz() {
  timed "fuzz build" scripts/setup.sh --fuzz --build build-asan --targets hp2_fuzz -DHP2_SANITIZE=address,undefined \
    "${sanitizer_options[@]}"
  local target failed=0 sum=0 n
  for target in $fuzz_targets; do
    [ -x "build-asan/bin/hp2_fuzz_$target" ] && continue
    echo "no clang++: the fuzz targets are left out (Debian packages clang-14 and libclang-rt-14-dev)"
    return 0
  done
  for target in $fuzz_targets; do
    while [ "$(jobs -rp | wc -l)" -ge 2 ]; do wait -n || failed=1; done
    fuzz_one "$target" &
  done
  while [ -n "$(jobs -p)" ]; do wait -n || failed=1; done
  for target in $fuzz_targets; do
    n=$(sed -n 's/^stat::number_of_executed_units: *//p' "build-asan/fuzz/$target/log")
    echo "fuzzed $target: ${n:-0} inputs"
    sum=$((sum + ${n:-0}))
  done
  echo "fuzzed in all: $sum messages and files"
  return "$failed"
}

case $what in
  plain) plain ;;
  sanitize) sanitize "$unit_programs" ;;
  fuzz) timed "fuzzing" fuzz ;;
  tsan) tsan ;;
  long) long ;;
  all)
    plain
    sanitize "$unit_programs"
    timed "fuzzing" fuzz
    echo "== all: $SECONDS s"
    ;;
esac
