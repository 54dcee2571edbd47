// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fuses scans on a device, ahead of the host: bit for bit what the host's map holds after the same scans
/// (docs/design/gpu.md, "The device leads").
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "hostdev/leaf_sums.h"
#include "hostdev/return_leaves.h"
#include "hostdev/return_ray.h"
#include "hostdev/vote_rule.h"
#include "launch/exact_updater.h"
#include "launch/grid_growth.h"

namespace accessvdb::kernels {

/// Of a map, the same for all its scans.
struct FusionSetting {
  RegionConstants region = {};
  KernelConstants constants = {};
  NewsRule news = {};
  bool votes = false;             ///< whether news may vote
  std::uint64_t cache_bytes = 0;  ///< most for values, unless a scan alone needs more; 0: no limit
};

/// What a scan did to the map.
struct FusedScan {
  FoldCounts counts;
  std::uint64_t touched_leaves = 0, changed_leaves = 0;
  std::uint64_t returned_leaves = 0;  ///< whose values came from the host
  std::uint64_t flips_hash = 0;       ///< hostdev/flips_hash.h
  GridGrowth growth;                  ///< valid until the next scan
};

/// A leaf's values, and what was cleared, as the host's map has them.
struct LeafRecord {
  GridGrowth::Origin origin_ijk = {};  ///< lowest voxel
  std::uint32_t values[512] = {};      ///< packed (hostdev/packed_mean.h)
  std::uint32_t cleared[16] = {};
};

/// Votes of a leaf, as the host's map has them (hostdev/vote_rule.h).
struct VotesRecord {
  GridGrowth::Origin origin_ijk = {};  ///< lowest voxel
  std::uint32_t votes[48] = {};        ///< three bits a voxel: 512 of each, the lowest first
};

/// The host's map, which gets the same scans later.
class FollowingMap {
 public:
  virtual ~FollowingMap() = default;
  /// Fills in leaves that have values and that no scan reached which the map has not got yet.
  virtual void read(std::span<LeafRecord> leaves) = 0;
  /// Scans that it has got.
  [[nodiscard]] virtual std::uint64_t scans() const = 0;
  /// Returns once it has got all of them.
  virtual void wait() = 0;
};

/// One for each mirror of facts, whose arena it writes to.
class ScanFuser {
 public:
  virtual ~ScanFuser() = default;
  ScanFuser(const ScanFuser&) = delete;
  ScanFuser& operator=(const ScanFuser&) = delete;

  /// Begins with the map that the host has, if that is not empty. Before the first scan.
  /// @param space  of its grid, which is on the device  @param with_values  leaves that have values: the host keeps
  /// them until a scan reaches them  @param votes  of leaves that have any
  /// @throws ResourceLimit
  virtual void begin(const GridSpace& space, std::span<const GridGrowth::Origin> with_values,
                     std::span<const VotesRecord> votes) = 0;

  /// Backs so many bytes of the arena behind GridSpace::top_bytes. @throws ResourceLimit
  using Reserve = std::function<void(std::uint64_t more_bytes)>;

  /// Fuses a scan, adds the leaves that it reaches to the grid, and switches bits.
  /// @param rays   the last `balls` of them are positions of the sensor
  /// @param space  of the grid before
  /// @throws ResourceLimit  there is no memory for the scan, or it lies too far apart; then nothing has changed
  /// @throws DeviceError    it is unknown what has
  virtual FusedScan fuse(std::span<const ReturnRay> rays, std::uint32_t balls, const GridSpace& space,
                         const Reserve& reserve, FollowingMap& host) = 0;

  /// The largest weight of the voxels around each of some, up to `reach` voxels along each axis; 0 where the voxel
  /// itself is not observed. @param voxels  [n]  @param reach  at most 4  @param weights  [n] out
  virtual void readWeights(std::span<const GridGrowth::Origin> voxels, int reach, std::span<std::uint16_t> weights,
                           FollowingMap& host) = 0;

  [[nodiscard]] virtual FlipsOnDevice flips() const = 0;
  /// Appends them to lists of the host, and clears them. Codes of voxels count from the first one of `voxels`.
  virtual void takeFlips(std::vector<LeafFlips>& leaves, std::vector<std::uint16_t>& voxels) = 0;
  virtual void clearFlips() = 0;

  [[nodiscard]] virtual std::uint64_t bytes() const = 0;  ///< of device memory, without the grid's

 protected:
  ScanFuser() = default;
};

}  // namespace accessvdb::kernels
