// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/pyramids_ply.h"

#include <array>
#include <bit>
#include <initializer_list>
#include <ostream>

#include "io/results/label_colours.h"
#include "io/results/program_version.h"

namespace accessvdb::internal {

void writePyramids(std::ostream& stream, const std::vector<Pyramid>& pyramids, const char* number_name) {
  static_assert(std::endian::native == std::endian::little, "records are copied directly from memory");
  stream << "ply\nformat binary_little_endian 1.0\ncomment AccessVDB " << programVersion() << "\nelement vertex "
         << 5 * pyramids.size()
         << "\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\n"
            "property uchar blue\nproperty int "
         << number_name << "\nelement face " << 5 * pyramids.size()
         << "\nproperty list uchar int vertex_indices\nend_header\n";
  const auto put = [&](const auto& value) {
    stream.write(reinterpret_cast<const char*>(&value), static_cast<std::streamsize>(sizeof value));
  };
  for (const Pyramid& one : pyramids) {
    const Eigen::Vector3d y = one.half_m * one.R_W.col(1), z = one.half_m * one.R_W.col(2);
    const std::array<Eigen::Vector3d, 5> corners = {one.tip_W, one.base_W + (y + z), one.base_W + (y - z),
                                                    one.base_W - (y + z), one.base_W - (y - z)};
    for (const Eigen::Vector3d& p : corners) {
      for (int axis = 0; axis < 3; ++axis) put(p[axis]);
      for (const std::uint8_t part : colourOf(one.colour)) put(part);
      put(one.number);
    }
  }
  const auto face = [&](std::initializer_list<std::int32_t> corners, std::int32_t begin) {
    put(static_cast<std::uint8_t>(corners.size()));
    for (const std::int32_t corner : corners) put(begin + corner);
  };
  for (std::int32_t begin = 0; begin < static_cast<std::int32_t>(5 * pyramids.size()); begin += 5) {
    face({0, 1, 2}, begin);
    face({0, 2, 3}, begin);
    face({0, 3, 4}, begin);
    face({0, 4, 1}, begin);
    face({4, 3, 2, 1}, begin);
  }
}

}  // namespace accessvdb::internal
