# shellcheck shell=bash
# Part of run_slam.sh: starts, watches and ends the four processes. It works on that script's arrays, by name of the
# process (backend, viewer, frontend, player): pid, and ended, the exit status of one that has ended.
# shellcheck disable=SC2154  # the variables are run_slam.sh's

start() {
  local command=()
  case $1 in
    backend) command=("$bin/hp2_backend" --session "$session" --exit-when-done "${meta[@]}") ;;
    viewer)
      command=("$bin/hp2_viewer_headless" --out "$out" --live-every "$live_every" "${truth[@]}" "${meta[@]}")
      [ "${ended[backend]:-}" != 0 ] || command+=(--session "$session")  # it died last of all
      ;;
    frontend) command=("$bin/hp2_frontend" --threads "$threads" ${mode_option[@]+"${mode_option[@]}"}) ;;
    player) command=("$bin/hp2_player" "$data" --rate "$rate" ${selection[@]+"${selection[@]}"} ${reading[@]+"${reading[@]}"} ${damaged[@]+"${damaged[@]}"}) ;;
  esac
  command+=(${configured[@]+"${configured[@]}"})
  # A session of its own: Ctrl-C reaches this script alone, which then stops the processes in order. Should this
  # script be killed, they end: front-end and player at once, for they own nothing and would wait for the others.
  local signal=TERM
  case $1 in player | frontend) signal=KILL ;; esac
  setsid setpriv --pdeathsig "$signal" "${command[@]}" "${common[@]}" 2>>"$logs/$1.log" 3>&- &
  pid[$1]=$!
  unset "ended[$1]"
}

alive() { [ -n "${pid[$1]:-}" ] && kill -0 "${pid[$1]}" 2>/dev/null; }
tell() { if alive "$2"; then kill "-$1" "${pid[$2]}" 2>/dev/null || :; fi; }

# Notes the exit status of a process that has ended in ended[NAME]; fails while it runs.
over() {
  [ -z "${ended[$1]:-}" ] || return 0
  [ -n "${pid[$1]:-}" ] || return 0
  if alive "$1"; then return 1; fi
  local status=0
  wait "${pid[$1]}" || status=$?
  ended[$1]=$status
}

all_over() {
  local name
  for name in "${names[@]}"; do over "$name" || return 1; done
}

# wait_all SECONDS: until all have ended.
wait_all() {
  local end=$((SECONDS + $1))
  until all_over; do
    [ "$SECONDS" -lt "$end" ] || return 1
    sleep 0.1 || :
  done
}

stop_at_once() {
  local name
  for name in "${names[@]}"; do tell TERM "$name"; done
  wait_all 2 || for name in "${names[@]}"; do tell KILL "$name"; done
  wait_all 5 || :
}

# The front-end cuts what it has, the back-end stores it, the viewer writes it; at most SECONDS, then all are stopped.
wind_up() {
  local end=$((SECONDS + $1)) told=""
  tell TERM player
  if ! over frontend && ! over backend; then tell TERM frontend; fi
  while ! all_over && [ "$SECONDS" -lt "$end" ]; do
    # Nothing more will come: who still waits writes what is there and goes.
    if [ -z "$told" ] && { over backend || { over frontend && [ "${ended[frontend]:-1}" != 0 ]; }; }; then
      told=yes
      tell KILL frontend
      tell TERM backend
      tell TERM viewer
    fi
    sleep 0.1 || :
  done
  stop_at_once
}
