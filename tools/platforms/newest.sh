#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Runs the test suite of this commit against the newest packages there are: in a root of Debian unstable, which has
# OpenVDB 13 and Fast DDS 3, newer compilers and a newer Python. Needs root and mmdebstrap; nothing outside FOLDER changes.
#   newest.sh FOLDER [SUITE [MIRROR]] [-- ARGUMENT-OF-TEST.SH...]     SUITE: unstable, or trixie, forky, ...
# What is in FOLDER from an earlier run is used again: the root, the compiler's cache, the build. Tests that need data of
# others look in $ACCESSVDB_TEST_DATA.
set -euo pipefail
fail() {
  echo "newest: error: $*" >&2
  exit 1
}
usage="usage: newest.sh FOLDER [SUITE [MIRROR]] [-- ARGUMENT-OF-TEST.SH...]"
(($# > 0)) || { echo "newest: error: no folder given. $usage" >&2; exit 2; }
folder=$(realpath -m "$1") suite=unstable mirror=http://deb.debian.org/debian
shift
if (($# > 0)) && [[ $1 != -- ]]; then suite=$1; shift; fi
if (($# > 0)) && [[ $1 != -- ]]; then mirror=$1; shift; fi
if (($# > 0)); then shift; fi
((EUID == 0)) || fail "a root of another distribution is entered as root: sudo $0 ..."
for need in mmdebstrap unshare git; do
  command -v "$need" >/dev/null || fail "'$need' is missing. On Debian and Ubuntu: apt install mmdebstrap util-linux git"
done
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
root=$folder/root

if [[ ! -e $root/etc/debian_version ]]; then
  rm -rf "$root"
  mkdir -p "$folder"
  # Release files of a mirror that lags behind have expired; they are signed all the same.
  mmdebstrap --mode=root --variant=minbase --include=ca-certificates,git,python3,sudo \
    --aptopt='Acquire::Check-Valid-Until "false"' "$suite" "$root" "$mirror" >"$folder/root.log" 2>&1 ||
    fail "no root of $suite: $(tail -n 1 "$folder/root.log")"
fi
# The commit, and nothing that is not in it.
mkdir -p "$root/work" "$root/data" "$root/ccache"
if [[ -d $root/work/accessvdb/.git ]]; then
  git -C "$root/work/accessvdb" fetch -q "$source" HEAD
  git -C "$root/work/accessvdb" checkout -q --force FETCH_HEAD
else
  git clone -q "file://$source" "$root/work/accessvdb"
fi
[[ ! -e /etc/resolv.conf ]] || cp -L /etc/resolv.conf "$root/etc/resolv.conf"

# Mounts that end with it, and no others of this machine.
export root data=${ACCESSVDB_TEST_DATA:-}
# shellcheck disable=SC2016
exec unshare --mount --pid --fork --mount-proc="$root/proc" bash -c '
  mount --rbind /dev "$root/dev"
  [[ -z $data ]] || mount --bind -o ro "$data" "$root/data"
  exec chroot "$root" env -i HOME=/root TERM=dumb LC_ALL=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    CCACHE_DIR=/ccache ${data:+ACCESSVDB_TEST_DATA=/data} bash -c "cd /work/accessvdb && exec ./tools/test.sh \"\$@\"" test.sh "$@"
' newest "$@"
