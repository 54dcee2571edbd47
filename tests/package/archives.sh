#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The packages made by cpack: their contents, and a consumer that uses the unpacked archive.
set -euo pipefail
out=$WORK/archives
rm -rf "$out"
mkdir -p "$out/unpacked"
generators=TGZ
if command -v dpkg-deb >/dev/null && command -v dpkg-shlibdeps >/dev/null; then generators="TGZ;DEB"; fi
"$CPACK" --config "$BUILD/CPackConfig.cmake" -G "$generators" -B "$out" >"$out/log" 2>&1 || { cat "$out/log"; exit 1; }

archive=$(echo "$out"/accessvdb-"$VERSION"-*.tar.gz)
tar -xzf "$archive" -C "$out/unpacked" --strip-components=1
for kind in static shared; do "$(dirname "$0")/find_package.sh" $kind "$out/unpacked"; done

[[ $generators == *DEB ]] || { echo "skipped the Debian packages: dpkg-deb or dpkg-shlibdeps is missing"; exit 77; }
bad=0
holds() {  # FILE PATTERN...
  local file=$1 listing
  listing=$(dpkg-deb -c "$file")
  shift
  for pattern in "$@"; do
    grep -qE "$pattern" <<<"$listing" || { echo "$file lacks $pattern"; bad=1; }
  done
}
runtime=$(echo "$out"/accessvdb_"$VERSION"_*.deb) development=$(echo "$out"/libaccessvdb-dev_"$VERSION"_*.deb)
lab=$(echo "$out"/accessvdb-lab_"$VERSION"_*.deb)
holds "$runtime" '/usr/bin/accessvdb$' "/libaccessvdb\.so\.$VERSION\$" '/share/doc/accessvdb/LICENSE$'
holds "$development" '/include/accessvdb/accessibility_field\.h$' '/include/accessvdb/config\.h$' '/libaccessvdb\.a$' \
  '/libaccessvdb\.so -> libaccessvdb\.so\.' '/AccessVDBConfig\.cmake$' '/pkgconfig/accessvdb\.pc$'
! dpkg-deb -c "$runtime" | grep -qE '\.h$|\.a$' || { echo "development files in the package of the program"; bad=1; }

holds "$lab" '/usr/bin/accessvdb-lab$'
[[ $(dpkg-deb -c "$lab" | grep -vc '/$') == 1 ]] || { echo "the package of the lab holds more than its program"; bad=1; }
for library in libembree libqhull; do
  [[ $(dpkg-deb -f "$lab" Depends) == *"$library"* ]] || { echo "the lab lacks $library"; bad=1; }
  [[ $(dpkg-deb -f "$runtime" Depends) != *"$library"* ]] || { echo "the program needs $library"; bad=1; }
done

needs=$(dpkg-deb -f "$runtime" Depends)
[[ $needs == *libopenvdb* && $needs == *libtbb* && $needs == *libassimp* ]] || { echo "dependencies: $needs"; bad=1; }
[[ $(dpkg-deb -f "$development" Depends) == *"accessvdb (= $VERSION)"*libopenvdb-dev* ]] || { echo "development lacks its dependencies"; bad=1; }
exit $bad
