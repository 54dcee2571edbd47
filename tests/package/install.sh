#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Installs into one folder, moves it to another, and checks the contents. The other tests use the moved folder.
set -euo pipefail
rm -rf "$WORK/first" "$WORK/moved"
"$CMAKE" --install "$BUILD" --prefix "$WORK/first" >/dev/null
mv "$WORK/first" "$WORK/moved"
cd "$WORK/moved"

bad=0
for file in bin/accessvdb bin/accessvdb-lab "$LIBDIR/libaccessvdb.a" "$LIBDIR/libaccessvdb.so" "$LIBDIR/libaccessvdb.so.$VERSION" \
  include/accessvdb/{accessibility_field,c_api,config,export}.h "$LIBDIR/pkgconfig/accessvdb.pc" \
  "$LIBDIR"/cmake/AccessVDB/AccessVDB{Config,ConfigVersion,StaticTargets,SharedTargets}.cmake share/doc/accessvdb/LICENSE; do
  [[ -e $file ]] || { echo "missing: $file"; bad=1; }
done

# Every public header is there, and no other.
diff <(cd "$SOURCE/include/accessvdb" && { ls -- *.h; echo config.h; echo device; echo program; } | LC_ALL=C sort) \
  <(cd include/accessvdb && ls | LC_ALL=C sort) || { echo "headers differ from the public ones"; bad=1; }

# No text file may contain the path of the build or of the first installation.
if grep -rnF -e "$WORK/first" -e "$SOURCE" -e "$BUILD" include "$LIBDIR/cmake" "$LIBDIR/pkgconfig"; then
  echo "paths of the build machine, see above"
  bad=1
fi
for program in accessvdb accessvdb-lab; do
  [[ $("./bin/$program" --version) == "$program $VERSION" ]] || { echo "$program does not run after the move"; bad=1; }
done
exit $bad
