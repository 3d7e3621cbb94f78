#!/usr/bin/env bash
# Speed and memory of the front-end alone and of the four processes, on drives of your choice. See --help.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
command -v python3 >/dev/null || {
  echo "benchmark.sh: python3 is missing. Install it: apt-get install python3" >&2
  exit 1
}
exec python3 -B "$here/reproduce/benchmark.py" "$@"
