#!/usr/bin/env bash
# Builds everything and maps a synthetic drive: no download needed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

usage() {
  cat <<'TEXT'
usage: scripts/demo.sh [DIR] [--overwrite] [--build DIR]

Builds everything and maps a synthetic drive through a small town: odometry drifts by metres, loop closures repair it. No
download is needed; the run takes up to 3 minutes, the first build longer.

  DIR            where the results go (default out/demo); refused if it is there already
  --overwrite    throw away the session and the results that are in DIR, and nothing else
  --build DIR    build folder (default build-demo)
  -h, --help     this text
TEXT
}

out="" overwrite=() build=build-demo drive=synthetic:district
while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) usage && exit 0 ;;
    --overwrite) overwrite=(--overwrite) && shift ;;
    --build)
      [ $# -ge 2 ] || { echo "demo.sh: --build needs a folder" >&2 && exit 2; }
      build=$2 && shift 2
      ;;
    -*) echo "demo.sh: unknown option $1. See scripts/demo.sh --help." >&2 && exit 2 ;;
    *)
      [ -z "$out" ] || { echo "demo.sh: two folders are given: $out and $1. Give one." >&2 && exit 2; }
      out=$1 && shift
      ;;
  esac
done
out=${out:-out/demo}
if [ ${#overwrite[@]} = 0 ] && [ -e "$out" ] && { [ ! -d "$out" ] || [ -n "$(ls -A -- "$out")" ]; }; then
  echo "demo.sh: $out is there already. Nothing was changed. Give another folder, or --overwrite." >&2
  exit 1
fi

scripts/setup.sh -DHP2_BUILD_TESTS=OFF --build "$build" \
  --targets "hp2_player hp2_frontend hp2_backend hp2_viewer_headless hp2_control"
scripts/run_slam.sh "$drive" --out "$out" --build "$build" ${overwrite[@]+"${overwrite[@]}"}
cat <<TEXT

report       $out/report.html (open it in a browser)
map          $out/map.ply (any point cloud viewer), $out/map_topdown.png
trajectory   $out/poses_tum.txt, $out/poses_kitti.txt, $out/trajectory.png
numbers      $out/summary.json
TEXT
