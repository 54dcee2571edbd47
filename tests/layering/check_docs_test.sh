#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Shows that check_docs.sh fires on a dead link, a missing heading, a dead path, and a citation of something missing, and on nothing else.
set -euo pipefail
checker=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/check_docs.sh
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree/docs" "$tree/src/io"
touch "$tree/src/io/ply.cpp" "$tree/docs/b.md"
printf '%s\n' '# The map' '## Scoring a point' >"$tree/docs/MAP.md"

expect() {  # expect EXIT_CODE DOCUMENT TEXT
  local code=0
  echo "$3" >"$tree/$2"
  "$checker" "$tree" >"$tree/out" || code=$?
  if ((code != $1)) || { ((code == 1)) && ! grep -q "$2: " "$tree/out"; }; then
    echo "FAILED: '$3' in $2: exit code $code instead of $1"
    exit 1
  fi
  rm "$tree/$2"
}

# shellcheck disable=SC2016  # the backticks are Markdown
{
  expect 0 README.md 'See [b](docs/b.md#part), [web](https://example.org/x.md) and `src/io/ply.cpp`; also `./src/io`.'
  expect 1 README.md 'See [c](docs/c.md).'
  expect 0 README.md 'See [scoring](docs/MAP.md#scoring-a-point).'
  expect 1 README.md 'See [scoring](docs/MAP.md#scoring).'
  expect 0 docs/a.md $'## A `b`, [c](b.md): d_e\nSee [itself](#a-b-c-d_e) and [up](../docs/MAP.md#the-map).'
  expect 1 docs/a.md 'See [itself](#a).'
  expect 1 README.md 'See ![picture](docs/none.png).'
  expect 1 README.md 'See `src/io/las.cpp`.'
  expect 0 docs/a.md 'See [b](b.md), [up](../src/io/ply.cpp) and `src/io/ply.cpp`.'
  expect 1 docs/a.md 'See [b](docs/b.md).'
  expect 0 src/io/a.h '/// The rule of docs/MAP.md, "Scoring a point"; writes tables.md. MAP.md says why. We issue a warning.'
  expect 0 src/CMakeLists.txt 'add_library(a INTERFACE)'
  expect 1 src/CMakeLists.txt '# As in SPEC b.'
  expect 1 src/io/a.h '/// The rule of SPEC a.3.'
  expect 1 src/io/a.h '/// The rule of SPEC.md (b).'
  expect 1 src/io/a.h '/// Bounds: issue 3.'
  expect 1 src/io/a.h '/// A row as in INTERFACE.'
  expect 1 src/io/a.h '/// See ARCHITECTURE.md.'
  expect 1 src/io/a.h '/// See docs/architecture.md.'
  expect 1 src/io/a.h '/// The rule of docs/MAP.md, "Scoring".'
  expect 1 README.md 'See issue #12.'
}
echo "every rule fires"
