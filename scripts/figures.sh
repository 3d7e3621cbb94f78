#!/usr/bin/env bash
# Writes the pages with figures from runs on the drives that are there. See --help.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
command -v python3 >/dev/null || {
  echo "figures.sh: python3 is missing. Install it: apt-get install python3" >&2
  exit 1
}
exec python3 -B "$here/reproduce/figures.py" "$@"
