#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds the programs without a GPU and makes what can be downloaded: the three Debian packages, and a tarball that
# runs without installing anything. Prints each file with its size.
#   make_packages.sh [OUT] [--limit MB] [-DNAME=VALUE...]     OUT: out/packages unless given; the tarball: at most 40 MB
# Only whole files reach OUT. -D goes to CMake. What the tarball contains is said in docs/licences.md.
set -euo pipefail
fail() {
  echo "make_packages: error: $*" >&2
  exit 1
}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
out=$source/out/packages limit=40 settings=()
while (($# > 0)); do
  case $1 in
    --limit)
      [[ ${2:-} =~ ^[0-9]+$ ]] || fail "--limit needs a number of megabytes"
      limit=$2
      shift
      ;;
    -D*) settings+=("$1") ;;
    -*) fail "unknown option '$1'. Use: make_packages.sh [OUT] [--limit MB] [-DNAME=VALUE...]" ;;
    *) out=$(realpath -m "$1") ;;
  esac
  shift
done
for need in "cpack cmake" "cmake cmake" "ninja ninja-build" "dpkg-deb dpkg" "dpkg-query dpkg" "dpkg-shlibdeps dpkg-dev" \
  "strip binutils" "xz xz-utils"; do
  command -v "${need% *}" >/dev/null ||
    fail "'${need% *}' is missing. Packages are made on Debian or Ubuntu: apt install ${need#* }"
done

# Scans, meshes and fields are large, and may belong to others.
refuse_data() {  # refuse_data FILE...
  local file data
  data=$(for file in "$@"; do
    case $file in *.deb) dpkg-deb --fsys-tarfile "$file" | tar -t ;; *) tar -tJf "$file" ;; esac
  done | grep -iE '\.(pcd|ply|las|laz|bin|bag|vdb|nvdb|obj|stl|csv|png|json)$|(^|/)(tests?|shared|out)/' || true)
  [[ -z $data ]] || fail "data must not go into the packages. Take it out of the install rules: ${data//$'\n'/ }"
}

build=$source/build/packages
"$source/tools/build_preset.sh" packages ${settings[@]+"${settings[@]}"} accessvdb accessvdb_cli accessvdb_lab accessvdb_shared make_sample_scans >&2 ||
  fail "the build failed, see above"

mkdir -p "$(dirname "$out")"
stage=$(mktemp -d "$out.XXXXXX")
trap 'rm -rf "$stage"' EXIT
mkdir "$stage/work" "$stage/done"
cpack --config "$build/CPackConfig.cmake" -G DEB -B "$stage/work" >"$stage/log" 2>&1 ||
  { cat "$stage/log" >&2; fail "cpack failed, see above"; }
mv "$stage"/work/*.deb "$stage/done/"
refuse_data "$stage"/done/*

version=$(sed -n 's/^set(CPACK_PACKAGE_VERSION "\(.*\)")/\1/p' "$build/CPackConfig.cmake")
name=accessvdb-$version-linux-$(uname -m)
"$source/tools/make_portable.sh" --name "$name" --limit "$limit" --headers-of "$build" "$stage/done/$name.tar.xz" - \
  "$build/bin/accessvdb" "$build/bin/accessvdb-lab" "$build/bin/make_sample_scans" >"$stage/log" || fail "no tarball, see above"

refuse_data "$stage/done/$name.tar.xz"

mkdir -p "$out"
for file in "$stage"/done/*; do
  chmod 644 "$file"
  mv -f "$file" "$out/"
  awk -v file="$out/${file##*/}" -v bytes="$(stat -c %s "$out/${file##*/}")" 'BEGIN { printf "%s: %.1f MB\n", file, bytes / 1e6 }'
done
