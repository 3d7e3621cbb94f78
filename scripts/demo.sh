#!/usr/bin/env bash
# Builds everything and maps a synthetic world: a loop through it, no download needed. Results in out/demo (or $1).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
out=${1:-out/demo}

scripts/setup.sh -DHP2_BUILD_TESTS=OFF --build build-demo
rm -rf "$out"
scripts/run_slam.sh synthetic:loop --out "$out" --build build-demo
cat <<TEXT

map          $out/map.ply (any point cloud viewer), $out/map_topdown.png
trajectory   $out/poses_tum.txt, $out/poses_kitti.txt, $out/trajectory.png
report       $out/report.html (open it in a browser)
numbers      $out/summary.json
TEXT
