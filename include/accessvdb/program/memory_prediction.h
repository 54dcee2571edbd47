// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much memory a run will take, told before the work starts.
///
/// Memory follows five counts: leaves that some return's double cone touches (they hold distances), leaves that only
/// a cleared band touches, nodes above the leaves (of 128^3 voxels each, as large as 15 leaves and often nearly empty),
/// surface voxels (one point each), and leaves that have any of those. All are numbers of distinct things over all
/// returns, so they are estimated by HyperLogLog counters: 64 KiB for any number of returns, and threads can merge
/// theirs.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tool_tables.h"

namespace accessvdb {

/// Estimates the number of distinct 64-bit hashes seen; standard error 0.8 %.
class ACCESSVDB_API DistinctCounter {
 public:
  DistinctCounter() : registers_(kRegisters, 0) {}
  void add(std::uint64_t hash) {
    const std::uint64_t index = hash >> (64 - kIndexBits);
    const auto rank = static_cast<std::uint8_t>(__builtin_clzll((hash << kIndexBits) | (1ULL << (kIndexBits - 1))) + 1);
    if (rank > registers_[index]) registers_[index] = rank;
  }
  void merge(const DistinctCounter& other);
  [[nodiscard]] double estimate() const;

 private:
  static constexpr int kIndexBits = 14;
  static constexpr std::size_t kRegisters = std::size_t{1} << kIndexBits;
  std::vector<std::uint8_t> registers_;
};

/// What a run makes of its map at the end.
enum class RunOutput {
  Field,             ///< the files of `map`
  FieldWithSurface,  ///< and a level set (WriteOptions::surface)
  Tile,              ///< the files of one tile; the picture of all tiles is drawn when there is no map in memory
  Labels             ///< snapshots alone, three of them (evaluate --consistency)
};

struct ACCESSVDB_API MemoryPrediction {
  std::uint64_t returns = 0;  ///< returns that it is drawn from
  double cone_leaves = 0;     ///< leaves that hold distances
  double band_leaves = 0;     ///< leaves that are only passed on the way to a return
  double nodes = 0;           ///< that the leaves hang on
  double surface_points = 0;
  double surface_leaves = 0;       ///< leaves that hold a surface point
  std::uint64_t largest_step = 0;  ///< returns of the largest step, which is fused at once
  std::uint64_t input_bytes = 0;   ///< what reading holds between steps, see ScanSequence::heldBytes()
  int remembered_directions = 0;   ///< see rememberedDirections()
  /// The peak of a run with a tool whose tables take no memory.
  /// @param with_distances  the mirror of distances is kept (FieldParams::mirror_distance)
  [[nodiscard]] double bytes(RunOutput output, bool with_distances = false) const;
};

/// Host memory for what a point remembers of directions, in units of one direction: with the exact policy a few more
/// than there are, because whole cache lines are taken, and only a few for large sets; none if a GPU remembers.
/// Of several tools their sum, plus what each but the first keeps per point, plus FieldParams::carry, in the same unit.
[[nodiscard]] ACCESSVDB_API int rememberedDirections(const std::vector<ToolSpec>& tools, const FieldParams& params);

/// The peak of a run: while the tool's tables are made there is no map yet.
/// @param without_tool  MemoryPrediction::bytes()
[[nodiscard]] ACCESSVDB_API double peakBytes(double without_tool, const ToolTableBytes& tool);

class ACCESSVDB_API MemoryPredictor {
 public:
  /// @param params  resolved parameters  @param remembered_directions  see rememberedDirections()
  explicit MemoryPredictor(const TsdfParams& params, int remembered_directions = 0);

  /// One return at p with the sensor at o, both relative to some fixed origin near the scene, metres.
  void add(const Eigen::Vector3d& o_L, const Eigen::Vector3d& p_L);
  /// As if all that went into `other` had come here.
  void merge(const MemoryPredictor& other);
  [[nodiscard]] MemoryPrediction prediction() const;

 private:
  void touchNode(const Eigen::Vector3d& centre);
  void touchBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& half, DistinctCounter& counter);
  /// Leaves with a voxel in the cylinder around axis u, `radius` wide and one slab thick.
  void touchSlab(const Eigen::Vector3d& centre, const Eigen::Vector3d& u, double radius, DistinctCounter& counter);

  TsdfParams params_;
  int remembered_directions_;
  double per_leaf_;  // 1 / edge of a leaf
  DistinctCounter cone_leaves_, band_leaves_, nodes_, surface_, surface_leaves_;
  std::uint64_t returns_ = 0;
};

/// What the machine can still give: physical memory and the limits of the control group. Nothing where unknown.
[[nodiscard]] ACCESSVDB_API std::optional<std::uint64_t> availableMemoryBytes();
/// Memory that this process takes now, and the most that it has taken.
[[nodiscard]] ACCESSVDB_API std::uint64_t residentMemoryBytes();
[[nodiscard]] ACCESSVDB_API std::uint64_t peakMemoryBytes();

}  // namespace accessvdb
