#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Installs missing packages of the distribution (Debian 12, Ubuntu 24.04 or newer). If nothing is missing, it does
# nothing and needs neither network nor root.
#   setup_debian.sh           the small set: what the library and the program need
#   setup_debian.sh --pcl     also PCL: its tests, its example, and accessvdb/pcl.h
#   setup_debian.sh --planning  also OMPL and OctoMap: accessvdb/ompl.h, its example, and export --octomap
#   setup_debian.sh --python  also what the Python module needs
#   setup_debian.sh --live    also Fast DDS, for the verb live
#   setup_debian.sh --gis     also GDAL, for export --raster and --vector
#   setup_debian.sh --lab     also Embree and Qhull, for accessvdb-lab
#   setup_debian.sh --tests   also what the test suite needs, all of these included; with npm, the packages of
#                             tests/recordings/package.json in build/npm
#   setup_debian.sh --all     everything
#   setup_debian.sh --list [any of these]   prints the packages of the set, one per line, and installs nothing
set -euo pipefail

fail() {
  echo "setup: error: $*" >&2
  exit 1
}

packages=(
  g++ cmake ninja-build pkg-config
  libopenvdb-dev libnanovdb-dev libboost-iostreams-dev  # the map; OpenVDB's CMake module requires iostreams
  libtbb-dev libeigen3-dev
  liblzf-dev                                            # compressed PCD scans
  libbz2-dev liblz4-dev libsqlite3-dev libzstd-dev zlib1g-dev  # recordings
  libassimp-dev                                         # tool meshes
  libpng-dev libssl-dev nlohmann-json3-dev              # pictures, hashes, reports
  libcli11-dev libtomlplusplus-dev                      # the command line
)
gis=(libgdal-dev)
live=(libfastrtps-dev libfastcdr-dev)
lab=(libembree-dev libqhull-dev)
planning=(libompl-dev liboctomap-dev)
python=(python3-dev python3-numpy python3-pip python3-venv pybind11-dev)
tests=(blender libgtest-dev libbenchmark-dev binutils bzip2 ccache mold clang-format cyclonedds-dev cyclonedds-tools
  dpkg-dev file gdal-bin libopenvdb-tools lz4
  mmdebstrap mypy patchelf proj-bin python3-distributed python3-matplotlib python3-nav-msgs python3-openvdb python3-rosbag python3-sensor-msgs
  python3-tf2-msgs sqlite3 xxd zstd)
# Ubuntu's Chromium is a snap, which cannot be driven from outside; tests that draw pages are skipped there.
grep -qx 'ID=ubuntu' /etc/os-release 2>/dev/null || tests+=(chromium)
list=false with_tests=false
for argument in "$@"; do
  case "$argument" in
    --list) list=true ;;
    --pcl) packages+=(libpcl-dev) ;;
    --python) packages+=("${python[@]}") ;;
    --live) packages+=("${live[@]}") ;;
    --gis) packages+=("${gis[@]}") ;;
    --lab) packages+=("${lab[@]}") ;;
    --planning) packages+=("${planning[@]}") ;;
    --tests | --all)
      with_tests=true
      packages+=(libpcl-dev "${python[@]}" "${live[@]}" "${gis[@]}" "${lab[@]}" "${planning[@]}" "${tests[@]}")
      ;;
    *) fail "unknown option '$argument'. Use --pcl, --python, --live, --gis, --lab, --planning, --tests, --all, --list or nothing." ;;
  esac
done
mapfile -t packages < <(printf '%s\n' "${packages[@]}" | awk '!seen[$0]++')
if $list; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  # Package names differ elsewhere; CMake names each missing library.
  for program in c++ cmake ninja; do
    command -v "$program" >/dev/null ||
      fail "'$program' is missing and this is not Debian or Ubuntu. Install it and the libraries listed in tools/setup_debian.sh."
  done
  echo "setup: not Debian or Ubuntu: nothing installed. CMake will name each library that is missing." >&2
  exit 0
fi

missing=()
for package in "${packages[@]}"; do
  state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [[ $state == installed ]] || missing+=("$package")
done
# Decoders and writers of others that tests compare with; without npm, without a network or with an older node such
# tests are skipped.
npm_packages() {
  local root folder
  root=$(dirname "${BASH_SOURCE[0]}")/..
  folder=$root/build/npm
  if ! $with_tests || ! command -v npm >/dev/null; then return 0; fi
  if cmp -s "$root/tests/recordings/package-lock.json" "$folder/package-lock.json" && [[ -d $folder/node_modules ]]; then
    return 0
  fi
  mkdir -p "$folder"
  cp "$root/tests/recordings/package.json" "$root/tests/recordings/package-lock.json" "$folder/"
  if ! (cd "$folder" && timeout 120 npm ci --silent --no-audit --no-fund --ignore-scripts) >&2; then
    rm -f "$folder/package-lock.json"
    echo "setup: npm could not install its packages: tests that read LAS or LAZ by them, or write ROS 2 recordings, will be skipped" >&2
  fi
}
npm_packages
((${#missing[@]} > 0)) || exit 0

as_root=()
if ((EUID != 0)); then
  command -v sudo >/dev/null || fail "missing packages and no sudo. As root: apt-get install ${missing[*]}"
  as_root=(sudo)
fi
echo "setup: installing ${missing[*]}" >&2
"${as_root[@]}" apt-get update -qq >&2 ||
  fail "apt-get update failed. Check the network and /etc/apt/sources.list, then run this again. Still missing: ${missing[*]}"
for package in "${missing[@]}"; do
  apt-cache show "$package" >/dev/null 2>&1 ||
    fail "this distribution has no package '$package'. Debian 12 and Ubuntu 24.04 have it."
done
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >&2 ||
  fail "apt-get could not install: ${missing[*]}"
