#!/usr/bin/env bash
# Builds the Debian packages into build-package/: hp2-slam, hp2-slam-dev, python3-hp2slam and debug symbols.
#   scripts/package.sh [--build DIR] [--check] [-DOPTION=VALUE ...]
# --check also runs lintian (installed if it is missing and this is root); an error of it fails.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

build=build-package check=0 options=()
while [ $# -gt 0 ]; do
  case $1 in
    --build) build=${2:?--build needs a folder} && shift 2 ;;
    --check) check=1 && shift ;;
    -D*) options+=("$1") && shift ;;
    -h | --help) sed -n '2,4s/^# \{0,1\}//p' "$0" && exit 0 ;;
    *) echo "package.sh: unknown option $1" >&2 && exit 2 ;;
  esac
done

needed=(dpkg-dev fakeroot file)
[ "$check" = 0 ] || needed+=(lintian)
missing=()
for package in "${needed[@]}"; do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ]; then
  if [ "$(id -u)" -ne 0 ]; then
    echo "package.sh: packages are missing. Install them: sudo apt-get install ${missing[*]}" >&2
    exit 1
  fi
  apt-get update
  DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}"
fi

# Debian's hardening flags. -g for the packages of debug symbols; what cpack strips is not larger for it.
flags="$(dpkg-buildflags --get CPPFLAGS) -g1 -fstack-protector-strong -ffile-prefix-map=$PWD=."
scripts/setup.sh --build "$build" -DHP2_BUILD_TESTS=OFF -DHP2_WITH_PYTHON=ON -DHP2_MAN_PAGES=ON -DCMAKE_INSTALL_PREFIX=/usr \
  -DCMAKE_INSTALL_LIBDIR="lib/$(dpkg-architecture -qDEB_HOST_MULTIARCH)" "-DCMAKE_CXX_FLAGS=$flags" \
  "-DCMAKE_EXE_LINKER_FLAGS=-Wl,-z,relro,-z,now" "-DCMAKE_MODULE_LINKER_FLAGS=-Wl,-z,relro,-z,now" ${options[@]+"${options[@]}"}
rm -f "$build"/*.deb "$build"/*.ddeb
(cd "$build" && cpack -G DEB)
ls -l "$build"/*.deb "$build"/*.ddeb 2>/dev/null || ls -l "$build"/*.deb
if [ "$check" = 1 ]; then
  lintian --fail-on error --suppress-tags bad-distribution-in-changes-file "$build"/*.deb
  echo "lintian: no errors"
fi
