#!/usr/bin/env bash
# Cross-builds for arm64: the package hp2-slam_*_arm64.deb, and the unit tests, which run under qemu-user. Needs root, mmdebstrap
# and the network. Works in a Debian 12 root of its own (some 3 GB), so that this machine's packages stay as they are.
#   scripts/packaging/cross_arm64.sh ROOT [package] [test [PROGRAM ...]]
# ROOT is the folder of that root, outside of the repository; it is made when it is not there. Results are in build-arm64/.
# Without further words both are done. PROGRAM: test programs (default common, transport, evaluation, frontend).
set -euo pipefail
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

case ${1:-} in
  -h | --help | "") sed -n '2,6s/^# \{0,1\}//p' "$0" && exit 0 ;;
esac
root=$1 && shift
package=0 test=0 programs=()
[ $# -gt 0 ] || { package=1 test=1; }
while [ $# -gt 0 ]; do
  case $1 in
    package) package=1 ;;
    test) test=1 ;;
    *_tests) programs+=("$1") ;;
    *) echo "cross_arm64.sh: unknown word $1; package, test, or programs like common_tests" >&2 && exit 2 ;;
  esac
  shift
done
[ ${#programs[@]} -gt 0 ] || programs=(common_tests transport_tests evaluation_tests frontend_tests)
[ "$(id -u)" = 0 ] || { echo "cross_arm64.sh: run this as root" >&2 && exit 1; }

# For this machine: tools. For arm64: the libraries of scripts/setup.sh. liblcm-bin has the same files for both: it is arm64's.
tools=(g++-aarch64-linux-gnu libc6-dev-arm64-cross cmake ninja-build dpkg-dev fakeroot file python3 qemu-user-static
  libeigen3-dev libcli11-dev nlohmann-json3-dev robin-map-dev libjs-chart.js)
libraries=(liblcm-bin liblcm-dev libopencv-dev libceres-dev libspdlog-dev libgtest-dev libgmock-dev libyaml-cpp-dev libsqlite3-dev
  libdeflate-dev libpcap-dev libzstd-dev liblz4-dev liblzf-dev libbz2-dev libbenchmark-dev)
if [ ! -e "$root/ready" ]; then
  command -v mmdebstrap >/dev/null || { echo "cross_arm64.sh: install mmdebstrap first" >&2 && exit 1; }
  mmdebstrap --variant=apt --architectures=amd64,arm64 --aptopt='APT::Install-Recommends "false"' \
    --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
    "--include=$(IFS=,; echo "${tools[*]}","${libraries[*]/%/:arm64}")" bookworm "$root"
  touch "$root/ready"
fi
# lcm-gen is arm64's; there need not be a binfmt handler.
printf '#!/bin/sh\nexec /usr/bin/qemu-aarch64-static /usr/bin/lcm-gen "$@"\n' >"$root/usr/local/bin/lcm-gen"
chmod +x "$root/usr/local/bin/lcm-gen"

targets=() build=$source/build-arm64
[ "$test" = 0 ] || targets+=("${programs[@]}")
[ "$package" = 0 ] || targets+=(hp2_player hp2_frontend hp2_backend hp2_viewer_headless hp2_control hp2_eval hp2_chart hp2_bench hp2_injector
  hp2_launcher hp2_man_pages)
mkdir -p "$root$source"
export root source build HP2_TARGETS="${targets[*]}" HP2_PROGRAMS="${programs[*]}" HP2_PACKAGE=$package HP2_TEST=$test
# The source folder stands at the same place in the root; the mount ends with this script.
# shellcheck disable=SC2016  # expanded by the inner shells
exec unshare -m bash -euc '
  mount --bind "$source" "$root$source"
  mount -t proc proc "$root/proc"
  exec chroot "$root" bash -euc '\''
    export LC_ALL=C.UTF-8
    cd "$source"
    flags="$(dpkg-buildflags --get CPPFLAGS) -g1 -fstack-protector-strong -ffile-prefix-map=$source=."
    cmake -S . -B "$build" -G Ninja -DCMAKE_TOOLCHAIN_FILE=scripts/packaging/arm64.cmake -DHP2_PRECOMPILE=ON -DHP2_MAN_PAGES=ON \
      -DCMAKE_INSTALL_PREFIX=/usr -DCMAKE_INSTALL_LIBDIR=lib/aarch64-linux-gnu -DCMAKE_SKIP_INSTALL_ALL_DEPENDENCY=ON \
      "-DCMAKE_CXX_FLAGS=$flags" "-DCMAKE_EXE_LINKER_FLAGS=-Wl,-z,relro,-z,now"
    cmake --build "$build" --parallel "$(nproc)" --target $HP2_TARGETS
    if [ "$HP2_PACKAGE" = 1 ]; then
      rm -f "$build"/*.deb "$build"/*.ddeb
      (cd "$build" && cpack -G DEB)
      ls -l "$build"/*.deb
    fi
    if [ "$HP2_TEST" = 1 ]; then
      for program in $HP2_PROGRAMS; do
        echo "== $program under qemu-aarch64"
        qemu-aarch64-static "$build/bin/$program" --gtest_brief=1
      done
    fi
  '\''
'
