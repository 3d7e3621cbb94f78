#!/usr/bin/env bash
# Plays a drive through all four processes and leaves map, trajectories, pictures and report in a folder.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=${HP2_BUILD_DIR:-$here/../build}

usage() {
  cat <<'TEXT'
usage: scripts/run_slam.sh DATA --out DIR [options]

  DATA              folder of a drive (its format is recognised), or synthetic:SCENE[:SEED]
  --out DIR         where the results go; a session that is in it already is taken up again
  --dataset NAME    format of the drive, if it is not to be recognised
  --config FILE     settings (YAML); see hp2_frontend --print-config
  --rate R|max      times real time; max (default): as fast as the front-end registers, no scan skipped
  --first N, --count N, --stride N   which scans
  --threads N       threads of the front-end (default 2)
  --mode M          the front-end's residuals and weights, e.g. hybrid
  --restart         start a process that dies again (5 times at most), and say so
  --live-every S    write the results every S seconds while the drive runs
  --lcm-url URL     LCM network to use (default: a port of this run's own, nothing leaves this machine)
  --build DIR       build folder (default: build)

example: scripts/run_slam.sh synthetic:loop --out out/demo
TEXT
}

die() {
  echo "run_slam.sh: $1" >&2
  exit "${2:-1}"
}

data="" out="" config="" restart=0 url="" live_every=0 threads=2 mode="" rate=max
selection=()
while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) usage && exit 0 ;;
    --restart) restart=1 && shift && continue ;;
    --*)
      [ $# -ge 2 ] || die "$1 needs a value. See scripts/run_slam.sh --help." 2
      case $1 in
        --out) out=$2 ;;
        --config) config=$2 ;;
        --rate) rate=$2 ;;
        --dataset | --first | --count | --stride) selection+=("$1" "$2") ;;
        --threads) threads=$2 ;;
        --mode) mode=$2 ;;
        --live-every) live_every=$2 ;;
        --lcm-url) url=$2 ;;
        --build) build=$2 ;;
        *) die "unknown option $1. See scripts/run_slam.sh --help." 2 ;;
      esac
      shift 2
      ;;
    *)
      [ -z "$data" ] || die "two drives are given: $data and $1. Give one." 2
      data=$1 && shift
      ;;
  esac
done
[ -n "$data" ] || { usage >&2 && exit 2; }
[ -n "$out" ] || die "no output folder is given. Add --out DIR." 2

bin=$build/bin
for program in hp2_player hp2_frontend hp2_backend hp2_viewer_headless hp2_control; do
  [ -x "$bin/$program" ] || die "$bin/$program is not there. Build first: scripts/setup.sh (or give --build DIR)."
done
logs=$out/logs
if ! mkdir -p "$logs" 2>/dev/null || ! (: >"$logs/.writable") 2>/dev/null; then
  die "the output folder cannot be written: $out. Choose another one with --out, or make it writable."
fi
rm -f "$logs/.writable"
[ -z "$config" ] || [ -r "$config" ] || die "the configuration cannot be read: $config. Check the path."

# Is the multicast that LCM needs there? If not: a network namespace of this run's own, where it is.
if [ -z "$url" ]; then
  for _ in $(seq 100); do
    port=$((20000 + RANDOM % 20000))
    grep -qi ":$(printf '%04X' "$port") " /proc/net/udp || break
  done
  url="udpm://239.255.76.67:$port?ttl=0"
fi
if ! "$bin/hp2_control" check --lcm-url "$url" >/dev/null 2>&1; then
  if [ -z "${HP2_IN_NAMESPACE:-}" ] && unshare -rn true 2>/dev/null; then
    again=("$data" --out "$out" --rate "$rate" --threads "$threads" --build "$build" --live-every "$live_every")
    again+=(${selection[@]+"${selection[@]}"})
    [ -z "$mode" ] || again+=(--mode "$mode")
    [ -z "$config" ] || again+=(--config "$config")
    [ "$restart" = 0 ] || again+=(--restart)
    # shellcheck disable=SC2016  # the inner shell expands it
    exec env HP2_IN_NAMESPACE=1 unshare -rn bash -c \
      'ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"' _ \
      "$here/run_slam.sh" "${again[@]}"
  fi
  die "multicast does not work on this machine. Run as root: ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo"
fi

common=(--lcm-url "$url")
configured=(${common[@]+"${common[@]}"})
[ -z "$config" ] || configured+=(--config "$config")
meta=(--meta "data=$data" --meta "command=run_slam.sh $data --rate $rate --threads $threads${mode:+ --mode $mode}"
  --meta "host=$(uname -n)" --meta "started=$(date -u +%Y-%m-%dT%H:%M:%SZ)")

mode_option=()
[ -z "$mode" ] || mode_option=(--mode "$mode")
settings=$("$bin/hp2_frontend" "${configured[@]}" ${mode_option[@]+"${mode_option[@]}"} --print-config &&
  "$bin/hp2_backend" --session x "${configured[@]}" --print-config &&
  "$bin/hp2_viewer_headless" --out x "${configured[@]}" --print-config) || exit 1
meta+=(--meta "configuration=$settings")

declare -A pid=() tries=()
names=(backend viewer frontend player)

start() {
  local command=()
  case $1 in
    backend) command=("$bin/hp2_backend" --session "$out/session" --exit-when-done "${configured[@]}" "${meta[@]}") ;;
    viewer) command=("$bin/hp2_viewer_headless" --out "$out" --ground-truth "$data" --live-every "$live_every"
      ${selection[@]+"${selection[@]}"} "${configured[@]}" "${meta[@]}") ;;
    frontend) command=("$bin/hp2_frontend" --threads "$threads" "${configured[@]}"
      ${mode_option[@]+"${mode_option[@]}"}) ;;
    player) command=("$bin/hp2_player" "$data" --rate "$rate" ${selection[@]+"${selection[@]}"} "${common[@]}") ;;
  esac
  # A session of its own: Ctrl-C reaches this script alone, which then stops the processes in order.
  setsid "${command[@]}" 2>>"$logs/$1.log" &
  pid[$1]=$!
}

alive() { [ -n "${pid[$1]:-}" ] && kill -0 "${pid[$1]}" 2>/dev/null; }

stop_all() {
  local name
  for name in player frontend backend viewer; do alive "$name" && kill -TERM "${pid[$name]}" 2>/dev/null; done
  for _ in $(seq 50); do
    for name in "${names[@]}"; do alive "$name" && sleep 0.1 && continue 2; done
    return 0
  done
  for name in "${names[@]}"; do alive "$name" && kill -KILL "${pid[$name]}" 2>/dev/null; done
  return 0
}

# Ctrl-C: no more scans; the front-end cuts what it has, the back-end stores it, the viewer writes it.
interrupted=0
interrupt() {
  interrupted=$((interrupted + 1))
  if [ "$interrupted" -gt 1 ]; then
    echo "stopping at once" >&2
    stop_all
    exit 130
  fi
  echo >&2
  echo "stopping: what was registered is stored and written (press Ctrl-C again to stop at once)" >&2
  alive player && kill -TERM "${pid[player]}"
  alive frontend && kill -TERM "${pid[frontend]}"
}
trap interrupt INT TERM
trap 'stop_all' EXIT

fail() {
  echo >&2
  echo "run_slam.sh: hp2_$1 ended with status $2. Its last words ($logs/$1.log):" >&2
  tail -n 8 "$logs/$1.log" | sed 's/^/  /' >&2
  [ "$1" = player ] || [ ! -d "$out/session" ] ||
    echo "What was registered is safe in $out/session; run the same command again to go on from there." >&2
  stop_all
  exit "$2"
}

for name in "${names[@]}"; do
  : >"$logs/$name.log"
  tries[$name]=0
  start "$name"
done

# Wait for all of them; a process that ends with another status than 0 ends the run, or is started again.
while :; do
  running=0
  for name in "${names[@]}"; do
    [ -n "${pid[$name]:-}" ] || continue
    if alive "$name"; then
      running=1
      continue
    fi
    status=0
    wait "${pid[$name]}" || status=$?
    pid[$name]=""
    [ "$status" -ne 0 ] || continue
    if [ "$interrupted" -gt 0 ]; then
      # A front-end that had not begun leaves nothing to wait for.
      if [ "$name" = frontend ]; then stop_all; fi
      continue
    fi
    if [ "$restart" = 1 ] && [ "$status" -gt 128 ] && [ "${tries[$name]}" -lt 5 ]; then
      tries[$name]=$((tries[$name] + 1))
      echo "hp2_$name died (status $status): started again, ${tries[$name]} of 5 times" | tee -a "$logs/$name.log" >&2
      start "$name"
      running=1
      continue
    fi
    if [ "$name" = player ]; then
      # Its drive cannot be read further: keep what was registered.
      if alive frontend; then
        kill -TERM "${pid[frontend]}"
        if wait "${pid[frontend]}" && alive viewer; then wait "${pid[viewer]}" || :; fi
      fi
    fi
    fail "$name" "$status"
  done
  [ "$running" = 1 ] || break
  sleep 0.2 || true
done
trap - EXIT
[ "$interrupted" -eq 0 ] || exit 130
echo "results in $out: map.ply, map_topdown.png, trajectory.png, poses_tum.txt, poses_kitti.txt, summary.json, report.html"
