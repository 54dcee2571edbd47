#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# docs/licences.md names each package whose library is in the tarball or whose header is in the program, and the tarball
# has a text for each library. Asks dpkg, not the script that made the tarball.
set -euo pipefail
tarball=$(echo "$WORK"/packages/accessvdb-*-linux-*.tar.xz)
[[ -e $tarball ]] || { echo "skipped: no tarball, see package.make_packages"; exit 77; }
# shellcheck disable=SC1091
[[ $(. /etc/os-release && echo "$VERSION_CODENAME") == bookworm ]] ||
  { echo "skipped: docs/licences.md has the package names of Debian 12"; exit 77; }
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
tar -C "$tree" -xJf "$tarball" --strip-components=1
table=${1:-$SOURCE/docs/licences.md}

row() { grep '^|' "$table" | grep -F "\`$1\`" || true; }
known=$(/sbin/ldconfig -p)
bad=0 libraries=0
# Uses only the library names in the tarball, and looks up where this machine's linker finds them.
for library in "$tree"/libraries/* "$tree"/runtime/*; do
  libraries=$((libraries + 1))
  name=$(basename "$library")
  path=$(readlink -f "$(awk -v name="$name" '$1 == name { print $NF; exit }' <<<"$known")")
  package=$({ dpkg -S "$path" || dpkg -S "${path#/usr}"; } 2>/dev/null | sed 's/:.*//')
  [[ -n $package ]] || { echo "no package owns $name"; bad=1; continue; }
  row "$package" | grep -qE 'linked|needed by' || { echo "the table lacks '$package' ($name)"; bad=1; }
  cmp -s "$tree/licences/$package" "/usr/share/doc/$package/copyright" || { echo "no licence text of '$package' in the tarball"; bad=1; }
done
((libraries >= 10)) || { echo "only $libraries libraries in the tarball"; bad=1; }

headers=$(ninja -C "$SOURCE/build/packages" -t deps | grep -oE '^ +/usr/include/.*' | sort -u)
packages=$(xargs readlink -f <<<"$headers" | xargs dpkg -S 2>/dev/null | sed 's/:.*//' | sort -u | grep -vxE 'libc6-dev|linux-libc-dev')
(($(wc -w <<<"$packages") >= 10)) || { echo "hardly any headers in build/packages"; bad=1; }
for package in $packages; do
  row "$package" | grep -q headers || { echo "the table lacks the headers of '$package'"; bad=1; }
  [[ -s $tree/licences/$package ]] || { echo "no licence text of '$package' in the tarball"; bad=1; }
done

# Texts that only refer to the common ones.
for common in $(grep -d skip -ohE 'common-licenses/(MPL-2.0|Apache-2.0|GPL-3)\b' "$tree"/licences/* | sort -u); do
  [[ -s $tree/licences/$common || ! -e /usr/share/$common ]] || { echo "the tarball lacks $common"; bad=1; }
done
cmp -s "$tree/licences/accessvdb" "$SOURCE/LICENSE" || { echo "the tarball lacks our own licence"; bad=1; }
exit $bad
