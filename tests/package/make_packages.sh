#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# tools/make_packages.sh creates the files that the other tests here install, and refuses bad input. Its build is also
# the one without PCL; with ccache, most of it comes from the previous build.
set -euo pipefail
for need in dpkg-deb dpkg-query dpkg-shlibdeps strip xz ninja; do
  command -v "$need" >/dev/null || { echo "skipped: $need is missing"; exit 77; }
done
out=$WORK/packages
mkdir -p "$WORK"
rm -rf "$out" "$WORK/refused"
settings=("-DACCESSVDB_WARNINGS_AS_ERRORS=${WARNINGS_AS_ERRORS:-OFF}" "-DCMAKE_CXX_COMPILER=$CXX")
make=$SOURCE/tools/make_packages.sh
export XZ_LEVEL=1  # faster, but larger than the published download
"$make" "$out" "${settings[@]}" | tee "$WORK/packages.txt"

bad=0
tarball=$(echo "$out"/accessvdb-"$VERSION"-linux-*.tar.xz)
[[ $(ls "$out" | wc -l) == 4 && $(wc -l <"$WORK/packages.txt") == 4 ]] || { echo "not four files: $(ls "$out")"; bad=1; }
(($(stat -c %s "$tarball") <= 40000000)) || { echo "the tarball has more than 40 MB"; bad=1; }

# The files contain only known kinds of files: no scans, no fields, no tests.
known='/$|/(bin|programs)/(accessvdb|accessvdb-lab|make_sample_scans)$|/run$|/README(\.md)?$|/CHANGELOG\.md$|/licences\.md$|/LICENSE$'
known+='|/licences/(common-licenses/)?[A-Za-z0-9.+-]+$|/lib[A-Za-z0-9_.+-]*\.(so[.0-9]*|a)$|/include/accessvdb/((device|program)/)?[a-z_]+\.h$'
known+='|/cmake/AccessVDB/AccessVDB[A-Za-z-]+\.cmake$|/pkgconfig/accessvdb\.pc$'
for file in "$out"/*; do
  case $file in *.deb) dpkg-deb --fsys-tarfile "$file" | tar -t ;; *) tar -tJf "$file" ;; esac
done >"$WORK/contents"
! grep -vE "$known" "$WORK/contents" || { echo "not of a kind that belongs into a package, see above"; bad=1; }

# Both have the verb live, and what it needs.
mkdir -p "$WORK/live"
rm -rf "$WORK/live"/*
tar -xJf "$tarball" -C "$WORK/live" --strip-components=1
says_live() { "$1" live --help >"$WORK/live_help" && grep -qF 'over DDS (Fast DDS ' "$WORK/live_help"; }
says_live "$WORK/live/bin/accessvdb" || { echo "no live in the tarball"; bad=1; }
compgen -G "$WORK/live/libraries/libfastrtps.so*" >/dev/null || { echo "no Fast DDS in the tarball"; bad=1; }
runtime=$(echo "$out"/accessvdb_"$VERSION"_*.deb)
[[ $(dpkg-deb -f "$runtime" Depends) == *libfastrtps* ]] || { echo "the program's package does not need Fast DDS"; bad=1; }
dpkg-deb -x "$runtime" "$WORK/live/deb"
says_live "$WORK/live/deb/usr/bin/accessvdb" || { echo "no live in the package"; bad=1; }

refuses() {  # refuses TEXT OUT COMMAND...: fails with one line that contains TEXT, and leaves no files
  local text=$1 out=$2 code=0
  shift 2
  "$@" >"$WORK/refusal" 2>&1 || code=$?
  ((code != 0)) || { echo "not refused: $text"; bad=1; }
  [[ $(grep -c '^make_packages: error: ' "$WORK/refusal") == 1 ]] && grep 'error:' "$WORK/refusal" | grep -qF -- "$text" ||
    { echo "no message with '$text':"; tail -n 5 "$WORK/refusal"; bad=1; }
  [[ -z $(ls -d "$out"* 2>/dev/null) ]] || { echo "half-written files after: $text"; bad=1; }
}
export XZ_LEVEL=0
refuses "no tarball" "$WORK/refused" "$make" "$WORK/refused" --limit 2 "${settings[@]}"
grep -qE "^make_portable: error: the archive has [0-9]+ bytes, more than 2 MB\..*libopenvdb" "$WORK/refusal" ||
  { echo "the limit is not explained"; bad=1; }
refuses "unknown option '--what'" "$WORK/refused" "$make" "$WORK/refused" --what
refuses "--limit needs a number" "$WORK/refused" "$make" "$WORK/refused" --limit much

# Without cpack; and with a cpack whose package contains a scan.
fake=$(mktemp -d)
trap 'rm -rf "$fake"' EXIT
mkdir "$fake/less" "$fake/more"
for tool in bash dirname realpath; do ln -s "$(command -v $tool)" "$fake/less/"; done
refuses "'cpack' is missing" "$WORK/refused" env "PATH=$fake/less" bash "$make" "$WORK/refused"
cat >"$fake/more/cpack" <<'END'
#!/bin/sh
while [ "$1" != -B ]; do shift; done
mkdir -p tree/usr/share/accessvdb tree/DEBIAN
touch tree/usr/share/accessvdb/000000.pcd
printf 'Package: accessvdb\nVersion: 0\nArchitecture: all\nMaintainer: none\nDescription: none\n' >tree/DEBIAN/control
dpkg-deb -b tree "$2/accessvdb_0_all.deb"
END
chmod +x "$fake/more/cpack"
cd "$fake"
refuses "data must not go into the packages" "$WORK/refused" env "PATH=$fake/more:$PATH" "$make" "$WORK/refused" "${settings[@]}"
exit $bad
