#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What the portable tarball says on a distribution whose C library is too old, in a bare root of Debian 11 (glibc 2.31):
# one line with code 5; and what the loader's own list lacks there, by file.
#   older_root.sh TARBALL
set -euo pipefail
fail() {
  echo "older_root: error: $*" >&2
  exit 1
}
tarball=${1:?usage: older_root.sh TARBALL}
[[ -f $tarball ]] || fail "no file $tarball. Make it: tools/make_packages.sh"
((EUID == 0)) || fail "only root may make another root"
command -v mmdebstrap >/dev/null || fail "'mmdebstrap' is missing: apt install mmdebstrap"

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT  # nothing stays mounted there
chmod 755 "$root"
mmdebstrap --variant=minbase --aptopt='Acquire::Check-Valid-Until "false"' bullseye "$root/root" http://deb.debian.org/debian >"$root/log" 2>&1 ||
  { tail -n 3 "$root/log" >&2; fail "no root could be made, see above"; }
mkdir -p "$root/root/opt/accessvdb"
tar -C "$root/root/opt/accessvdb" -xf "$tarball" --strip-components=1
inside() { chroot "$root/root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C "$@"; }

code=0
inside /opt/accessvdb/bin/accessvdb --version >"$root/out" 2>"$root/err" || code=$?
cat "$root/out" "$root/err"
((code == 5)) && [[ ! -s $root/out && $(wc -l <"$root/err") == 1 ]] && grep -qF 'accessvdb: error[start.glibc]' "$root/err" ||
  fail "expected one line with start.glibc and code 5, not code $code"

echo "what the loader lacks there, and the number of files that need it:"
loader=$(LC_ALL=C readelf -l "$root/root/opt/accessvdb/programs/accessvdb" | sed -n 's/.*interpreter: \(.*\)\]/\1/p')
inside env LD_LIBRARY_PATH=/opt/accessvdb/libraries LD_TRACE_LOADED_OBJECTS=1 "$loader" /opt/accessvdb/programs/accessvdb 2>&1 |
  sed -n "s/.*version \`\(.*\)' not found (required by \(.*\))/\1 \2/p" | LC_ALL=C sort -u | cut -d ' ' -f 1 | uniq -c
