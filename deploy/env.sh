# shellcheck shell=bash
# Sourced by deploy/launch, deploy/check, deploy/site and .ci/run.
#
# ensure_environment EXTRA   finds or makes a Python environment, brings sumo-dist[EXTRA] in it up to
#                            date with this checkout, and leaves its interpreter in $python; an
#                            empty EXTRA is the package alone, without viewer and films.
#
# An active virtual or conda environment is used if there is one, .venv at the root otherwise.
# PYTHON=python3.12 chooses .venv and the interpreter it is made with.
#
# The install is editable: changed Python files need nothing. A stamp in the environment holds a
# checksum of what does need an install: dependencies, native sources, compiler, interpreter, place,
# and the names of the Python files, which the editable install lists.

set -euo pipefail

root=$(cd -P -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)

ensure_environment() {
  local extra=$1 environment stamp key
  check_links
  choose_environment
  python=$environment/bin/python
  stamp=$environment/.sumo-dist
  key=$(fingerprint "${PYTHON:-$python}")
  if [ -f "$stamp" ]; then
    case $(<"$stamp") in
      "$key $extra" | "$key dev") return ;; # dev contains the other extras
      "$key "*) [ -n "$extra" ] || return 0 ;;
    esac
    extra=$(both "$extra" "$(<"$stamp")")
  fi
  update_environment
}

# The extra to install where one is wanted and the stamp says which there was: none gets lost.
both() {
  case "$2" in
    *" dev") printf 'dev\n' ;;
    *" view") printf '%s\n' "${1:-view}" ;;
    *) printf '%s\n' "$1" ;;
  esac
}

say() { printf '%s\n' "$*" >&2; }

die() {
  say "${0##*/}: $*"
  exit 3
}

# A checkout without symbolic links has small text files in their place.
check_links() {
  local name
  for name in assets policies services tasks; do
    [ -d "$root/sumo_dist/$name" ] ||
      die "sumo_dist/$name is no link to ../$name; check out again with" \
        "'git config core.symlinks true && git checkout -- sumo_dist'"
  done
}

choose_environment() {
  environment=${VIRTUAL_ENV:-}
  if [ -z "$environment" ] && [ "${CONDA_DEFAULT_ENV:-base}" != base ]; then
    environment=${CONDA_PREFIX:-}
  fi
  if [ -z "$environment" ] || [ -n "${PYTHON:-}" ]; then
    environment=$root/.venv
  elif ! is_supported "$environment/bin/python"; then
    die "the active environment $environment has no Python 3.11, 3.12 or 3.13:" \
      "deactivate it, or name an interpreter to make .venv with, as in PYTHON=python3.12 $0"
  fi
}

is_supported() {
  "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

find_python() {
  local name
  for name in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11; do
    if is_supported "$name"; then
      printf '%s\n' "$name"
      return
    fi
    [ -z "${PYTHON:-}" ] || die "PYTHON=$PYTHON is not a Python 3.11, 3.12 or 3.13"
  done
  die "found no Python 3.11, 3.12 or 3.13; name one, as in PYTHON=/path/to/python3.12 $0"
}

fingerprint() {
  {
    printf '%s\n' "$root"
    "$1" -c 'import sys; print(sys.version)' 2>/dev/null || true
    command -v "${CXX:-c++}" g++ clang++ || true
    find "$root"/{sumo_dist,policies,services,tasks} -name '*.py' | LC_ALL=C sort
    cat -- "$root/pyproject.toml" "$root/CMakeLists.txt" "$root"/sumo_dist/rollout/cpp/*
  } | cksum
}

# Installs, and takes away an environment that it began and could not finish.
update_environment() {
  local log began=$SECONDS
  log=$(mktemp "${TMPDIR:-/tmp}/sumo-dist-install.XXXXXX")
  trap 'exit 130' INT TERM
  if [ "$environment" = "$root/.venv" ]; then
    make_venv
  fi
  key=$(fingerprint "$python")
  local package=sumo-dist${extra:+[$extra]}
  say "Installing $package in $environment (the first time takes a minute or two)"
  "$python" -m pip --version >"$log" 2>&1 || "$python" -m ensurepip >>"$log" 2>&1 || fail pip
  "$python" -m pip install --no-input --disable-pip-version-check \
    --editable "$root${extra:+[$extra]}" 2>&1 | tee "$log" | show_progress || fail "$package"
  printf '%s %s\n' "$key" "$extra" >"$stamp"
  rm -f -- "$log"
  trap - EXIT INT TERM
  say "Installed in $((SECONDS - began)) s. To use it: source $environment/bin/activate, or call" \
    "$environment/bin/sumo-dist"
}

make_venv() {
  local base
  base=$(find_python)
  if is_supported "$python" && { [ -z "${PYTHON:-}" ] || same_version "$python" "$base"; }; then
    return
  fi
  trap 'rm -rf -- "$root/.venv"' EXIT
  "$base" -m venv --clear "$environment" >"$log" 2>&1 || fail "a virtual environment with $base"
}

same_version() {
  local version='import sys; print(sys.version)'
  [ "$("$1" -c "$version")" = "$("$2" -c "$version")" ]
}

# One line that changes on a terminal; nothing where the output is kept.
show_progress() {
  local line
  while IFS= read -r line; do
    [ ! -t 2 ] || printf '\r\033[K  %.76s' "$line" >&2
  done
  [ ! -t 2 ] || printf '\r\033[K' >&2
}

fail() {
  say "$(tail -n 12 -- "$log")"
  die "could not install $1; the whole log is in $log. Mend the cause and run this again."
}
