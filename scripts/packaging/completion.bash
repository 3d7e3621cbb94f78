# Completion of hp2-slam and the hp2_* programs in bash. Options and commands come from --help, so they are never out of date.
_hp2_options() { "$@" --help 2>/dev/null | grep -oE -- '(^|[ ,])--[a-z][a-z-]*' | grep -oE -- '--[a-z-]+' | sort -u; }

_hp2() {
  local program=$1 current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} words=() asked=("$1")
  COMPREPLY=()
  if [ "${program##*/}" = hp2-slam ]; then
    if [ "$COMP_CWORD" -eq 1 ]; then
      mapfile -t words < <("$program" --help 2>/dev/null | sed -n '/^Commands:/,/^Options:/s/^  \([a-z][a-z_]*\) .*/\1/p')
      mapfile -t COMPREPLY < <(compgen -W "${words[*]} --help --version" -- "$current")
      return
    fi
    asked+=("${COMP_WORDS[1]}")
  fi
  case $previous in
    --mode)
      mapfile -t COMPREPLY < <(compgen -W "robust hybrid point_to_point point_to_plane fixed_alpha fixed_threshold" -- "$current")
      return
      ;;
    --log-level)
      mapfile -t COMPREPLY < <(compgen -W "trace debug info warn error off" -- "$current")
      return
      ;;
  esac
  case $current in
    -*) mapfile -t COMPREPLY < <(compgen -W "$(_hp2_options "${asked[@]}")" -- "$current") ;;
    *)
      if [ "${asked[*]##*/}" = "hp2-slam control" ] || [ "${program##*/}" = hp2_control ]; then
        mapfile -t COMPREPLY < <(compgen -W "list check pause resume step stop export" -- "$current")
      else
        mapfile -t COMPREPLY < <(compgen -f -W "synthetic:district synthetic:loop synthetic:figure8 synthetic:corridor synthetic:tiny" -- "$current")
        compopt -o filenames 2>/dev/null
      fi
      ;;
  esac
}
complete -F _hp2 hp2-slam hp2_player hp2_frontend hp2_backend hp2_viewer_headless hp2_control hp2_eval hp2_bench hp2_calibrate
