#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What tools/setup_debian.sh does and says, with fake apt-get and dpkg-query programs: nothing is installed.
set -euo pipefail
setup=$SOURCE/tools/setup_debian.sh
fake=$(mktemp -d)
trap 'rm -rf "$fake"' EXIT
mkdir "$fake/bin"
# INSTALLED: installed packages. UPDATE, INSTALL: exit codes. UNKNOWN: a package that the distribution lacks.
cat >"$fake/bin/dpkg-query" <<'END'
#!/bin/sh
for package; do :; done  # the last argument
case " $INSTALLED " in *" $package "* | *" all "*) echo installed ;; *) exit 1 ;; esac
END
cat >"$fake/bin/apt-get" <<'END'
#!/bin/sh
echo "apt-get $*" >>"$CALLS"
[ "$1" = update ] && exit "$UPDATE"
exit "$INSTALL"
END
cat >"$fake/bin/apt-cache" <<'END'
#!/bin/sh
[ "$2" != "$UNKNOWN" ]
END
printf '#!/bin/sh\nexec "$@"\n' >"$fake/bin/sudo"
chmod +x "$fake"/bin/*
export CALLS=$fake/calls INSTALLED= UPDATE=0 INSTALL=0 UNKNOWN=

bad=0
run() {  # run CODE ARGUMENTS...
  local expected=$1 code=0
  shift
  : >"$CALLS"
  PATH=$fake/bin:$PATH "$setup" "$@" >"$fake/out" 2>"$fake/err" || code=$?
  ((code == expected)) || { echo "exit code $code instead of $expected from: $*"; cat "$fake/err"; bad=1; }
}
says() { grep -qE -- "$1" "$fake/err" || { echo "no line like '$1' in:"; cat "$fake/err"; bad=1; }; }
calls() { grep -qE -- "$1" "$CALLS" || { echo "no call like '$1' in:"; cat "$CALLS"; bad=1; }; }
silent() { [[ ! -s $CALLS ]] || { echo "called: $(<"$CALLS")"; bad=1; }; }

INSTALLED=all run 0
silent
[[ ! -s $fake/err ]] || { echo "noise although everything is there"; bad=1; }

INSTALLED="g++ cmake" run 0
calls '^apt-get update'
calls '^apt-get install .*--no-install-recommends.* libopenvdb-dev '
! grep -qE ' (g\+\+|cmake|libpcl-dev)( |$)' "$CALLS" || { echo "installs what is there or was not asked for"; bad=1; }

UPDATE=100 run 1
says '^setup: error: apt-get update failed\. Check the network and .*sources.* Still missing: .*libopenvdb-dev'
! grep -q install "$CALLS" || { echo "installs without the list of packages"; bad=1; }

UNKNOWN=libembree-dev run 1 --lab
says "^setup: error: this distribution has no package 'libembree-dev'\. Debian 12 and Ubuntu 24\.04 have it"
! grep -q install "$CALLS" || { echo "installs half of it"; bad=1; }

INSTALL=100 run 1
says '^setup: error: apt-get could not install: g\+\+ cmake'

run 1 --pcll
says "^setup: error: unknown option '--pcll'\. Use .*--list"
silent

# --list needs no network, calls nothing, and prints each package once, one per line.
run 0 --list
silent
grep -qx libopenvdb-dev "$fake/out" && ! grep -qxE 'libpcl-dev|libembree-dev|libqhull-dev|mmdebstrap' "$fake/out" || { echo "the small list is wrong"; bad=1; }
cp "$fake/out" "$fake/small"
run 0 --pcl --list --tests
silent
grep -qx mmdebstrap "$fake/out" && [[ $(grep -cx libpcl-dev "$fake/out") == 1 ]] || { echo "the list of the tests is wrong"; bad=1; }
! grep -qE '[^a-z0-9.+-]' "$fake/out" || { echo "not one package per line"; bad=1; }
[[ -z $(comm -23 <(sort "$fake/small") <(sort "$fake/out")) ]] || { echo "the larger list lacks packages of the small one"; bad=1; }

# The packages of npm: only for the tests, from a copy of the tree without them, and no failure if they cannot be had.
mkdir -p "$fake/tree/tools" "$fake/tree/tests/recordings"
cp "$(dirname "$setup")"/../tests/recordings/package*.json "$fake/tree/tests/recordings/"
cp "$setup" "$fake/tree/tools/"
setup=$fake/tree/tools/setup_debian.sh
printf '#!/bin/sh\necho "npm $*" >>"$CALLS"\nexit "$NPM"\n' >"$fake/bin/npm"
chmod +x "$fake/bin/npm"
export NPM=0
INSTALLED=all run 0
silent
INSTALLED=all run 0 --tests
calls '^npm ci '
NPM=1 INSTALLED=all run 0 --tests
says 'tests that read LAS or LAZ by them, or write ROS 2 recordings, will be skipped'
INSTALLED=all run 0 --tests
calls '^npm ci '
mkdir -p "$fake/tree/build/npm/node_modules"
INSTALLED=all run 0 --tests
silent
exit $bad
