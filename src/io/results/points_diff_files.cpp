// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// diff.ply and diff.vdb: what changed between two maps, for viewers.
#include <bit>
#include <cstring>
#include <ostream>

#include "accessvdb/program/points_diff.h"
#include "accessvdb/surface_points.h"
#include "io/results/field_grids.h"
#include "io/results/label_colours.h"
#include "io/results/program_version.h"
#include "io/results/surface_voxels.h"
#include "io/streams/exact_text.h"

namespace accessvdb::io {
namespace {

static_assert(std::endian::native == std::endian::little, "records are copied directly from memory");

constexpr std::uint8_t kNoSide = 255;
constexpr std::size_t kRecordBytes = 3 * 8 + 3 + 5 + 3 * 4;
constexpr std::size_t kRecordsPerBlock = 16384;

/// Of the palette of Okabe and Ito, like the colours of the reasons.
constexpr internal::Rgb colourOf(PointChange change) {
  constexpr internal::Rgb kColours[kNumPointChanges] = {
      {0, 158, 115}, {213, 94, 0}, {150, 152, 156}, {0, 114, 178}, {204, 121, 167}};
  return kColours[static_cast<int>(change)];
}

template <typename T>
char* put(char* to, const T& value) {
  std::memcpy(to, &value, sizeof(T));
  return to + sizeof(T);
}

char* putRecord(char* to, const ChangedPoint& changed) {
  const bool was = changed.change != PointChange::Appeared, is = changed.change != PointChange::Gone;
  const auto code = [](bool exists, auto value) { return exists ? static_cast<std::uint8_t>(value) : kNoSide; };
  for (int axis = 0; axis < 3; ++axis) to = put(to, changed.point.position_W[axis]);
  to = put(to, colourOf(changed.change));
  to = put(to, static_cast<std::uint8_t>(changed.change));
  to = put(to, code(was, changed.label_before));
  to = put(to, code(was, changed.reason_before));
  to = put(to, code(is, changed.point.label));
  to = put(to, code(is, changed.point.reason));
  for (int axis = 0; axis < 3; ++axis) to = put(to, changed.point.direction_W[axis]);
  return to;
}

/// The points of one kind of change, as the grids' maker wants them.
class PointsOfChange final : public SurfacePoints {
 public:
  PointsOfChange(const PointsDiff& diff, PointChange change) : diff_(diff) {
    for (const ChangedPoint& changed : diff.points) {
      if (changed.change == change) points_.push_back(&changed.point);
    }
  }
  [[nodiscard]] std::size_t size() const override { return points_.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override { return *points_[index]; }
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override { return points_[index]->position_W; }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return diff_.origin_W; }
  [[nodiscard]] double voxel_size_m() const override { return diff_.voxel_size_m; }

 private:
  const PointsDiff& diff_;
  std::vector<const SurfacePoint*> points_;
};

openvdb::GridBase::Ptr fogOf(const PointsDiff& diff, PointChange change, const openvdb::MetaMap& metadata) {
  const PointsOfChange points(diff, change);
  const auto all = [](const SurfacePoint&) { return true; };
  const auto one = [](const SurfacePoint&, std::uint32_t) { return 1.0f; };
  auto grid = internal::SurfaceVoxels(points).grid<openvdb::FloatGrid>(name(change), 0.0f, all, one);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  for (const char* key : {"origin_W_x", "origin_W_y", "origin_W_z", "length_unit", "up_axis", "accessvdb_version"}) {
    grid->insertMeta(key, *metadata[key]);
  }
  return grid;
}

}  // namespace

void writeDiffPly(const std::filesystem::path& path, const PointsDiff& diff) {
  writeFileDurably(path, [&](std::ostream& stream) {
    stream << "ply\nformat binary_little_endian 1.0\ncomment AccessVDB " << internal::programVersion() << " diff\n"
           << "comment origin_W " << internal::exactText(diff.origin_W.x()) << " "
           << internal::exactText(diff.origin_W.y()) << " " << internal::exactText(diff.origin_W.z())
           << "\ncomment voxel_size_m " << internal::exactText(diff.voxel_size_m) << "\ncomment change";
    for (int n = 0; n < kNumPointChanges; ++n) stream << " " << n << "=" << name(static_cast<PointChange>(n));
    stream << "\nelement vertex " << std::to_string(diff.points.size()) << "\n";
    for (const char* axis : {"x", "y", "z"}) stream << "property double " << axis << "\n";
    for (const char* byte : {"red", "green", "blue", "change", "label_before", "reason_before", "label", "reason"}) {
      stream << "property uchar " << byte << "\n";
    }
    for (const char* axis : {"dx", "dy", "dz"}) stream << "property float " << axis << "\n";
    stream << "end_header\n";
    std::vector<char> block(kRecordsPerBlock * kRecordBytes);
    char* to = block.data();
    for (const ChangedPoint& changed : diff.points) {
      to = putRecord(to, changed);
      if (to == block.data() + block.size()) {
        stream.write(block.data(), static_cast<std::streamsize>(block.size()));
        to = block.data();
      }
    }
    stream.write(block.data(), to - block.data());
  });
}

void writeDiffVdb(const std::filesystem::path& path, const PointsDiff& diff) {
  openvdb::initialize();
  const auto metadata = internal::fieldMetadata(PointsOfChange(diff, PointChange::Opened), {});
  std::vector<internal::LazyGrid> grids;
  for (int n = 0; n < kNumPointChanges; ++n) {
    const auto change = static_cast<PointChange>(n);
    grids.push_back({name(change), [&diff, &metadata, change] { return fogOf(diff, change, metadata); }});
  }
  writeFileDurably(path, [&](std::ostream& stream) { internal::writeGrids(stream, grids, metadata); });
}

}  // namespace accessvdb::io
