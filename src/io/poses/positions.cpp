// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {

std::vector<Eigen::Vector3d> readPositions(const std::filesystem::path& path) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  std::vector<Eigen::Vector3d> positions;
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    Eigen::Vector3d p;
    bool good = tokens.size() == 3;
    for (int axis = 0; good && axis < 3; ++axis) good = parseNumber(tokens[axis], p[axis]) && std::isfinite(p[axis]);
    if (!good) lines.fail("is not three finite numbers", "Write one 'x y z' or 'x,y,z' per line, in metres");
    positions.push_back(p);
  }
  return positions;
}

}  // namespace accessvdb::io
