#!/usr/bin/env bash
# Runs the paper's tables and figures on the data that is on this disk. See --help.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
command -v python3 >/dev/null || {
  echo "reproduce.sh: python3 is missing. Install it: apt-get install python3" >&2
  exit 1
}
exec python3 -B "$here/reproduce/reproduce.py" "$@"
