// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Streams of scans whose states are saved, and the bytes of files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/attributes.h"
#include "support/determinism_support.h"

namespace accessvdb::test {

/// Scans, as scans or as rays that each have their own sensor position, and where they are interrupted.
struct Stream {
  FieldParams params;
  std::vector<Scan> scans;
  bool ray_cloud = false;
  std::size_t stop = 0;
};

inline void integrate(AccessibilityField& field, const Stream& stream, std::size_t from, std::size_t to) {
  for (std::size_t n = from; n < to; ++n) {
    const Scan& scan = stream.scans[n];
    if (!stream.ray_cloud) {
      field.integrateScan(scan.points_S, scan.T_W_S);
      continue;
    }
    std::vector<Eigen::Vector3d> points_W, sensors_W;
    for (const Eigen::Vector3f& p_S : scan.points_S) {
      points_W.push_back(scan.T_W_S * p_S.cast<double>());
      sensors_W.push_back(scan.T_W_S.translation() +
                          Eigen::Vector3d(0, 1e-5 * static_cast<double>(sensors_W.size()), 0));
    }
    field.integrateRays(points_W, sensors_W);
  }
}

/// The same with a tree and a row that the returns carry, for params that ask for both.
inline void integrateCarrying(AccessibilityField& field, const Stream& stream, std::size_t from, std::size_t to) {
  for (std::size_t n = from; n < to; ++n) {
    const Scan& scan = stream.scans[n];
    std::vector<std::int32_t> attributes;
    for (std::size_t i = 0; i < scan.points_S.size(); ++i) {
      attributes.push_back(i % 11 == 0 ? kNoAttribute : static_cast<std::int32_t>((i + n) % 3));
      attributes.push_back(static_cast<std::int32_t>(i));
    }
    field.integrateScan(scan.points_S, scan.T_W_S, static_cast<double>(n), attributes);
  }
}
inline std::vector<CarriedAttribute> treeAndRow() { return {{"tree", Keep::Majority}, {"index", Keep::First}}; }

inline FieldParams cpuParams(double voxel_size_m = 0.05) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.range_noise_m = 0.01;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  params.approach.num_directions = 36;
  return params;
}

inline std::string bytesOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
inline void writeBytes(const std::filesystem::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace accessvdb::test
