#!/usr/bin/env bash
# Plays a drive through all four processes and leaves map, trajectories, pictures and report in a folder.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=${HP2_BUILD_DIR:-$here/../build}
[ -d "$build" ] || [ ! -x "$here/../../../bin/hp2_player" ] || build=$here/../../..  # installed: share/hp2-slam/scripts
arguments=("$@")
restarts=5        # of one process, with --restart
ctrl_c_limit=20   # seconds to store and write after Ctrl-C
failure_limit=60  # the same after a process has failed

usage() {
  cat <<'TEXT'
usage: scripts/run_slam.sh DATA --out DIR [options]

  DATA              folder or file of a drive (its format is recognised), or synthetic:SCENE[:SEED]
  --out DIR         where the results go. A session of the same drive and settings that is in it is gone on with
                    until its results are written; a finished one, or another drive's, is refused and left as it is
  --overwrite       throw away the session and the results in --out, and begin anew
  --dataset NAME    format of the drive, if it is not to be recognised
  --topic NAME      topic of a bag, channel of a log, or sender's address in a packet capture, if there are several
  --metadata FILE   Ouster's metadata JSON of a packet capture, if it does not lie beside it
  --bin-layout NAME records of .bin scans, if they are not to be recognised; see hp2_player --help
  --times-unit U, --points-unit U   units of scans' times (s, ms, us, ns) and points (m, cm, mm), if not to be found
  --skip-damaged    go on where a scan cannot be read: it is left out, counted and reported
  --ground-truth-topic NAME  topic of a bag with poses to compare with (Odometry, PoseStamped, NavSatFix)
  --sweep NAME, --vertical-correction auto|on|off   how the points lie in the sweep, and KITTI's angles; see hp2_player --help
  --config FILE     settings (YAML); see hp2_frontend --print-config
  --rate R|max      times real time; max (default): as fast as the front-end registers, no scan skipped
  --first N, --count N, --stride N   which scans
  --threads N       threads of the front-end (default 2)
  --mode M          the front-end's residuals and weights, e.g. hybrid
  --restart         start a process that dies again (5 times at most), and say so
  --live-every S    write the results every S seconds while the drive runs
  --lcm-url URL     LCM network to use (default: a port of this run's own, nothing leaves this machine)
  --give-up-after S end when nothing has happened for S seconds (default 120; 0: never)
  --build DIR       build folder (default: build)
  -h, --help        this text

Ctrl-C ends the session: what was registered is stored and written. A second Ctrl-C stops at once; an unfinished
session is gone on with by the same command.
Exit status: 0 all is written; 2 wrong command line; 130 after Ctrl-C; otherwise that of the process that failed.

example: scripts/run_slam.sh synthetic:loop --out out/demo
TEXT
}

# As it can be pasted into a shell, whatever is in the words.
quoted() {
  local words
  printf -v words '%q ' "$@"
  printf '%s' "${words% }"
}

# The user is spoken to through 3: later on stderr goes to a log, which may be on a full disk.
exec 3>&2
die() {
  echo "run_slam.sh: $1" >&3
  exit "${2:-1}"
}

data="" out="" config="" restart=0 overwrite=0 url="" live_every=0 threads=2 mode="" rate=max give_up_after=120 id=""
selection=() damaged=() reading=()
while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) usage && exit 0 ;;
    --restart) restart=1 && shift && continue ;;
    --overwrite) overwrite=1 && shift && continue ;;
    --skip-damaged) damaged=(--skip-damaged) && shift && continue ;;
    --*)
      case $1 in
        --out | --config | --rate | --dataset | --topic | --ground-truth-topic | --metadata | --bin-layout | --first | --count | \
          --stride | --threads | --mode | --live-every | --lcm-url | --give-up-after | --build | --times-unit | --points-unit | --sweep | --vertical-correction) ;;
        *) die "unknown option $1. See scripts/run_slam.sh --help." 2 ;;
      esac
      [ $# -ge 2 ] || die "$1 needs a value. See scripts/run_slam.sh --help." 2
      case $1 in
        --out) out=$2 ;;
        --config) config=$2 ;;
        --rate) rate=$2 ;;
        --dataset | --topic | --ground-truth-topic | --metadata | --bin-layout | --first | --count | --stride | --times-unit | --points-unit) selection+=("$1" "$2") ;;
        --sweep | --vertical-correction) reading+=("$1" "$2") ;;
        --threads) threads=$2 ;;
        --mode) mode=$2 ;;
        --live-every) live_every=$2 ;;
        --lcm-url) url=$2 ;;
        --give-up-after) give_up_after=$2 ;;
        --build) build=$2 ;;
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
[ -z "$config" ] || [ -r "$config" ] || die "the configuration cannot be read: $config. Check the path."
logs=$out/logs session=$out/session
if ! mkdir -p "$logs" 2>/dev/null || ! (: >"$logs/.writable") 2>/dev/null; then
  die "the output folder cannot be written: $out. Choose another one with --out, or make it writable."
fi
# An empty file fits on a full disk; what a run begins with does not.
if ! (head -c 65536 /dev/zero >"$logs/.writable") 2>/dev/null; then
  rm -f "$logs/.writable"
  die "the disk is full: nothing can be written to $out. Free some space on it, or choose another folder with --out."
fi
rm -f "$logs/.writable"

# What is in --out already? Asked before anything is started.
configured=()
[ -z "$config" ] || configured+=(--config "$config")
mode_option=()
[ -z "$mode" ] || mode_option=(--mode "$mode")
settings=$("$bin/hp2_frontend" ${configured[@]+"${configured[@]}"} ${mode_option[@]+"${mode_option[@]}"} --print-config &&
  "$bin/hp2_backend" --session x ${configured[@]+"${configured[@]}"} --print-config &&
  "$bin/hp2_viewer_headless" --out x ${configured[@]+"${configured[@]}"} --print-config) || exit 1
drive=$(realpath -q -e -- "$data" || echo "$data")${selection[*]+" ${selection[*]}"}${reading[*]+" ${reading[*]}"}
same=(--meta "drive=$drive" --meta "configuration=$settings")
# A run whose player could not read on has left its results, and this mark: the same command plays the drive again.
unread=$session/drive_not_read
if [ "$overwrite" = 0 ] && [ -e "$unread" ] && [ "$(cat "$unread")" = "$drive $settings" ]; then
  echo "the last run could not read all of the drive: it is played again from its beginning"
  overwrite=1
fi
if [ "$overwrite" = 0 ]; then
  if ! found=$("$bin/hp2_backend" --session "$session" --check "${same[@]}" 2>&1); then
    echo "run_slam.sh: $found" >&2
    cat >&2 <<TEXT
Nothing was changed. Either
  give another folder             --out DIR
  throw it away, begin anew       --overwrite
  write its results once more     $(quoted "$bin/hp2_viewer_headless" --session "$session" --out "$out")
TEXT
    exit 1
  fi
  case $found in going*) sed '/^session id /d' <<<"$found" ;; esac
  id=$(sed -n 's/^session id //p' <<<"$found")
else
  # Nothing is thrown away for a drive that cannot be played.
  "$bin/hp2_player" "$data" ${selection[@]+"${selection[@]}"} ${reading[@]+"${reading[@]}"} --info >/dev/null || exit 1
  if [ -e "$session/session.lock" ] && ! flock -n "$session/session.lock" true; then
    die "another run uses $session. Stop that one first, or give another --out."
  fi
fi

# Is the multicast that LCM needs there? If not: a network namespace of this run's own, where it is.
own_url=$url
if [ -z "$url" ]; then
  for _ in $(seq 100); do
    port=$((20000 + RANDOM % 20000))
    grep -qi ":$(printf '%04X' "$port") " /proc/net/udp || break
  done
  url="udpm://239.255.76.67:$port?ttl=0"
fi
if ! said=$("$bin/hp2_control" check --quick --lcm-url "$url" 2>&1); then
  if [ -z "${HP2_IN_NAMESPACE:-}" ] && [ -z "$own_url" ] && command -v ip >/dev/null && unshare -rn true 2>/dev/null; then
    # shellcheck disable=SC2016  # the inner shell expands it
    exec env HP2_IN_NAMESPACE=1 unshare -rn bash -c \
      'ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"' _ \
      "$here/run_slam.sh" "${arguments[@]}"
  fi
  echo "$said" >&2
  die "multicast does not work on this machine, and it permits no network namespace of our own (unshare -rn). Run as root, then this again:
  ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo"
fi

if [ "$overwrite" = 1 ]; then
  rm -f "$unread" "$session"/session.sqlite{,-wal,-shm,.new} "$out"/poses_{tum,kitti,odometry_kitti}.txt "$out"/map.{ply,pcd} \
    "$out"/{map_topdown,trajectory}.png "$out"/{summary.json,report.html,closures.csv,graph.g2o} "$out/lcm_url" \
    "$logs"/{backend,viewer,frontend,player,run_slam}.log
fi

# Where hp2_control and other programs find this run.
printf '%s\n' "$url" >"$out/lcm_url"
reach=()
[ -z "${HP2_IN_NAMESPACE:-}" ] || reach=(nsenter --preserve-credentials -U -n -t "$$")
echo "LCM: $url (also in $(quoted "$out/lcm_url")), e.g. $(quoted ${reach[@]+"${reach[@]}"} "$bin/hp2_control" list --lcm-url "$url")"

# All four take part in this session and in no other that is on the same network.
[ -n "$id" ] || id=$(od -An -N7 -tu8 /dev/urandom | tr -d ' ')
common=(--lcm-url "$url" --session-id "$id" --give-up-after "$give_up_after")
meta=(--meta "data=$data" --meta "command=$(quoted run_slam.sh "$data" --rate "$rate" --threads "$threads")${mode:+ --mode $mode}"
  --meta "host=$(uname -n)" --meta "started=$(date -u +%Y-%m-%dT%H:%M:%SZ)" "${same[@]}")
truth=(--ground-truth "$data" ${selection[@]+"${selection[@]}"} ${damaged[@]+"${damaged[@]}"})

# The shell has words of its own on processes that were killed: they are for the log.
exec 2>>"$logs/run_slam.log"

declare -A pid=() tries=() ended=()
names=(backend viewer frontend player)

# shellcheck source=scripts/run_slam/processes.sh
. "$here/run_slam/processes.sh"

# What a session holds, in words; nothing if it holds nothing.
stored() {
  [ -e "$session/session.sqlite" ] || return 0
  { "$bin/hp2_backend" --session "$session" --check 2>&1 || :; } | grep -oE '[1-9][0-9]* scans? in [0-9]+ submaps?' | head -n 1
}

# After an end that was none: the results of what is stored, unless the viewer has written them.
write_stored() {
  local holds again=("$bin/hp2_viewer_headless" --session "$session" --out "$out")
  holds=$(stored) || :
  if [ -z "$holds" ]; then
    echo "no submap was finished: there are no results" >&3
    return
  fi
  if [ "${ended[viewer]:-1}" != 0 ]; then
    local status=0 why
    timeout -k 2 "$1" "${again[@]}" "${truth[@]}" ${configured[@]+"${configured[@]}"} >/dev/null 2>>"$logs/viewer.log" ||
      status=$?
    if [ "$status" != 0 ]; then
      why="in $1 s"
      [ "$status" = 124 ] || [ "$status" = 137 ] || why="($(tail -n 1 "$logs/viewer.log" 2>/dev/null))"
      echo "$holds are stored in $session; the results could not be written $why. Write them with" >&3
      echo "  $(quoted "${again[@]}")" >&3
      return
    fi
  fi
  echo "$holds are stored in $session, and their results written to $out" >&3
}

# Whether the same command would go on with the session, or nothing is left to do.
say_what_is_next() {
  local said
  if said=$("$bin/hp2_backend" --session "$session" --check "${same[@]}" 2>&1); then
    echo "the same command goes on from there once the cause is mended"
  elif [[ $said == *"the session is complete"* ]]; then
    echo "it failed after the session was complete and written: nothing is left to do"
  else
    echo "$said"
  fi
}

interrupted=0
interrupt() {
  interrupted=$((interrupted + 1))
  [ "$interrupted" -gt 1 ] || return 0
  echo "stopping at once" >&3
  stop_at_once
  exit 130
}

fail() {
  local name=$1 status=$2 how="ended with status $2"
  [ "$status" -le 128 ] || how="was killed by signal $(kill -l $((status - 128)) 2>/dev/null || echo $((status - 128)))"
  [ "$status" != 130 ] || how="was stopped by somebody else"
  {
    echo
    echo "run_slam.sh: hp2_$name $how. The last lines of $logs/$name.log:"
    tail -n 8 "$logs/$name.log" | sed 's/^/  /'
    echo "stopping the others"
  } >&3
  case $name in
    player)  # its drive cannot be read further: what was registered is kept
      wind_up "$failure_limit"
      [ ! -d "$session" ] || printf '%s' "$drive $settings" >"$unread"
      ;;
    *)
      # The session is not ended, so that the same command goes on with it.
      for other in player frontend; do tell KILL "$other"; done
      tell TERM backend
      if [ "$live_every" = 0 ]; then tell KILL viewer; else tell TERM viewer; fi
      wait_all 5 || :
      stop_at_once
      ;;
  esac
  write_stored "$failure_limit"
  [ "$name" != player ] || echo "the same command plays the drive again once it is mended; --skip-damaged leaves out what cannot be read" >&3
  [ "$name" = player ] || [ ! -e "$session/session.sqlite" ] || say_what_is_next >&3
  exit "$status"
}

trap 'interrupt' INT TERM HUP
trap 'stop_at_once' EXIT
for name in "${names[@]}"; do
  (echo "--- $(date -u +%Y-%m-%dT%H:%M:%SZ) $drive" >>"$logs/$name.log") 2>/dev/null ||
    die "$logs/$name.log cannot be written. Free some space on its disk, or choose another folder with --out."
  tries[$name]=0
  start "$name"
done

# What a process says of waiting is said to the user, too.
waited=$(grep -h "nothing has happened for" "$logs"/*.log 2>/dev/null | tail -n 1) || :
say_who_waits() {
  local line
  line=$(grep -h 'nothing has happened for' "$logs"/*.log 2>/dev/null | tail -n 1) || :
  [ -n "$line" ] && [ "$line" != "$waited" ] || return 0
  waited=$line
  echo "$line" >&3
}

# Waits for all of them; a process that fails ends the run, or is started again.
patience=""
while :; do
  if [ "$interrupted" -gt 0 ]; then
    echo >&3
    echo "stopping: what was registered is stored and written (Ctrl-C again to stop at once)" >&3
    wind_up "$ctrl_c_limit"
    write_stored "$ctrl_c_limit"
    trap - EXIT
    exit 130
  fi
  for name in "${names[@]}"; do
    over "$name" || continue
    status=${ended[$name]}
    [ "$status" -ne 0 ] || continue
    [ -z "$patience" ] || [ "$name" = viewer ] || continue
    if [ "$restart" = 1 ] && [ "$status" -ge 70 ] && [ "${tries[$name]}" -lt "$restarts" ]; then
      tries[$name]=$((tries[$name] + 1))
      echo "hp2_$name died (status $status): started again, ${tries[$name]} of $restarts times" | tee -a "$logs/$name.log" >&3
      start "$name"
      continue
    fi
    [ "${tries[$name]}" -lt "$restarts" ] || echo "hp2_$name has died $((restarts + 1)) times: given up" >&3
    fail "$name" "$status"
  done
  # All is written: who was just started again, or missed the end, need not wait for what will not come.
  if [ -z "$patience" ] && [ "${ended[viewer]:-}" = 0 ]; then patience=$((SECONDS + 10)); fi
  if [ -n "$patience" ] && [ "$SECONDS" -ge "$patience" ]; then stop_at_once; fi
  if [ "$interrupted" = 0 ] && all_over; then break; fi
  if [ $((SECONDS % 10)) = 0 ]; then say_who_waits; fi
  sleep 0.2 || :
done
trap - EXIT
echo "results in $out: map.ply, map_topdown.png, trajectory.png, poses_tum.txt, poses_kitti.txt, summary.json, report.html"
