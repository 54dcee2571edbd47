// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"
#include "io/streams/point_lines.h"

namespace accessvdb::io {

std::vector<Eigen::Vector3d> readPositions(const std::filesystem::path& path) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  PointLines points(lines);
  std::vector<Eigen::Vector3d> positions;
  Eigen::Vector3d p;
  const auto fail = [&] {
    lines.fail("is not three finite numbers", "Write one 'x y z' or 'x,y,z' per line, in metres");
  };
  while (points.next(p)) {
    if ((!points.named() && points.columns() != 3) || !p.allFinite()) fail();
    positions.push_back(p);
  }
  if (points.cutOff()) fail();
  if (const auto announced = points.announced().value_or(positions.size()); announced != positions.size())
    throw InputError(
        "input.truncated", lines.subject(),
        "announces " + std::to_string(announced) + " positions and has " + std::to_string(positions.size()),
        "Copy the file again");
  return positions;
}

}  // namespace accessvdb::io
