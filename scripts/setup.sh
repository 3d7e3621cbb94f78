#!/usr/bin/env bash
# Installs what is missing (Debian packages only) and builds everything into build/.
#   scripts/setup.sh [--build DIR] [--targets "NAME ..."] [--fuzz] [-DOPTION=VALUE ...]      e.g. -DHP2_NATIVE=ON
# --fuzz also installs clang, which the fuzz targets need; without it they are left out.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

build=build fuzz=0 targets=all
options=()
while [ $# -gt 0 ]; do
  case $1 in
    --build) build=${2:?--build needs a folder} && shift 2 ;;
    --fuzz) fuzz=1 && shift ;;
    --targets) targets=${2:?--targets needs names} && shift 2 ;;
    -D*) options+=("$1") && shift ;;
    -h | --help) sed -n '2,4s/^# \{0,1\}//p' "$0" && exit 0 ;;
    *) echo "setup.sh: unknown option $1" >&2 && exit 2 ;;
  esac
done

packages=(build-essential cmake ninja-build liblcm-dev liblcm-bin libeigen3-dev libopencv-dev libceres-dev
  libspdlog-dev libgtest-dev libgmock-dev libcli11-dev libyaml-cpp-dev nlohmann-json3-dev libsqlite3-dev libdeflate-dev
  libpcap-dev libzstd-dev liblz4-dev liblzf-dev libbz2-dev
  sqlite3 libbenchmark-dev robin-map-dev libjs-chart.js python3 iproute2)
# The Python package (-DHP2_WITH_PYTHON=ON) needs more.
case " ${options[*]-} " in *" -DHP2_WITH_PYTHON=ON "*) packages+=(pybind11-dev python3-dev python3-numpy) ;; esac
installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q '^install ok installed$'; }
missing=()
for package in "${packages[@]}"; do installed "$package" || missing+=("$package"); done
if [ ${#missing[@]} -gt 0 ]; then
  command=(apt-get install -y --no-install-recommends "${missing[@]}")
  if [ "$(id -u)" -ne 0 ]; then
    echo "setup.sh: packages are missing. Install them, then run this again:" >&2
    echo "  sudo apt-get update && sudo ${command[*]}" >&2
    exit 1
  fi
  apt-get update
  DEBIAN_FRONTEND=noninteractive "${command[@]}"
fi
if [ "$fuzz" = 1 ] && ! command -v clang++ clang++-14 >/dev/null; then
  command=(apt-get install -y --no-install-recommends clang-14 libclang-rt-14-dev)
  if [ "$(id -u)" -ne 0 ] || ! { apt-get update && DEBIAN_FRONTEND=noninteractive "${command[@]}"; }; then
    echo "setup.sh: there is no clang++, which the fuzz targets need. Install it with: sudo ${command[*]}" >&2
  fi
fi

cmake -S . -B "$build" -G Ninja -DHP2_PRECOMPILE=ON ${options[@]+"${options[@]}"}
# shellcheck disable=SC2086  # several names in one word
cmake --build "$build" --parallel "$(nproc)" --target $targets
