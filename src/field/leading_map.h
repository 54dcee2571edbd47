// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A map that a device fuses first, and the host afterwards: the device has each scan's facts at once, and the host's
/// map, which is the authority, gets the same scans on a thread of its own (docs/design/gpu.md, "The device leads").
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/params.h"
#include "field/map_follower.h"
#include "field/returning_values.h"
#include "launch/backend.h"
#include "launch/scan_fuser.h"
#include "mirror/nanovdb_mirror.h"
#include "points/surface_index.h"
#include "tsdf/packed_map.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {

/// What a map holds before a device leads: of values only which leaves have them.
struct HeldByMap {
  std::vector<kernels::GridGrowth::Origin> with_values;
  std::vector<kernels::VotesRecord> votes;
};
[[nodiscard]] HeldByMap heldBy(const PackedMap& map);

/// Of a map and its mirror of facts.
struct MapBytes {
  std::uint64_t held = 0;          ///< on the host, and in the mirror
  std::uint64_t at_most_more = 0;  ///< once the host has all scans
};

/// @throws DeviceError "device.diverged"
[[noreturn]] void throwDiverged();

/// For one thread at a time, as the field.
class LeadingMap final : private kernels::FollowingMap {
 public:
  /// Whether a device may lead at all with these parameters.
  [[nodiscard]] static bool mayLead(const FieldParams& resolved);
  /// @param fuser, map, integrator, facts  must outlive this; the mirror has the map
  /// @throws ResourceLimit  there is no room on the device for what the map holds
  LeadingMap(std::unique_ptr<kernels::ScanFuser> fuser, PackedMap& map, ScanIntegrator& integrator,
             NanoVdbMirror& facts, const FieldParams& resolved);
  /// Waits for the host's map.
  ~LeadingMap() override;

  /// Whether the device still leads. If not, the host's map has all scans, and fuses the next ones at once.
  [[nodiscard]] bool leads() const { return leads_; }
  /// Whether it is worth it.
  [[nodiscard]] bool pays() const { return !returning_.areTooMany(); }
  /// Prepares fuse(), of the same returns, beside an update.
  void prepare(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  /// Fuses a scan into the mirror of facts, and gives it to the host's map. No update may read the mirror meanwhile.
  /// @return nothing if there is no room on the device, or its map differs: then it no longer leads, and the scan is in
  /// neither map
  /// @throws DeviceError  then the host's map has the scan nevertheless
  [[nodiscard]] std::optional<kernels::FusedScan> fuse(std::span<const Eigen::Vector3f> p_L,
                                                       std::span<const Eigen::Vector3f> q_L, const ScanFrame& frame);
  /// For a scan that cannot be fused because the device failed. @throws what failed on the host
  void takeOnHost(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L, const ScanFrame& frame);
  /// Whether the host's map has all scans.
  [[nodiscard]] bool hostHasAll() const { return follower_.behind() == 0; }
  /// As MapReads::weights_at, of the device's map. Thread-safe.
  void readWeightsAt(std::span<const Index3> voxels, int reach, std::span<std::uint16_t> weights);

  /// Waits until the host's map has all scans; then it and the mirror may be changed, but no values that the device may
  /// hold: for that stop().
  /// @throws what failed on the host
  void catchUp();
  /// The same, and the device no longer leads.
  void stop();

  /// Whether the host's map turned out to be another one than the device's. So far: of scans that it has not got yet
  /// nothing is known. The mirror, and what was found out with it, are wrong then.
  [[nodiscard]] bool diverged() const { return differs_ || follower_.diverged().has_value(); }

  /// Gives back the device's memory. Only once it no longer leads.
  void forgetDevice() { fuser_.reset(); }

  [[nodiscard]] std::uint64_t deviceBytes() const { return fuser_ ? fuser_->bytes() : 0; }
  /// Does not wait for the host's map.
  [[nodiscard]] MapBytes mapBytes();

 private:
  /// Nodes that the device added, until the host's topology has them.
  struct Growth {
    std::vector<kernels::GridGrowth::Origin> uppers, lowers, leaves;
    std::uint64_t at_most_bytes = 0;  ///< that the scan adds to the map and the mirror
  };

  void read(std::span<kernels::LeafRecord> leaves) override;
  [[nodiscard]] std::uint64_t scans() const override { return follower_.taken(); }
  void wait() override { follower_.join(); }

  [[nodiscard]] std::uint64_t takeIntoMap(const MapFollower::Scan& scan);
  [[nodiscard]] std::uint64_t heldNow() const { return map_.memoryBytes() + facts_.usedBytes() + facts_.hostBytes(); }
  void leave();
  void reserve(std::uint64_t more_bytes);

  PackedMap& map_;
  ScanIntegrator& integrator_;
  NanoVdbMirror& facts_;
  std::atomic<bool> leads_ = true;  ///< an update beside a scan may find that the device failed
  /// The device asked for what the host's map does not have, or added what is there.
  std::atomic<bool> differs_ = false;
  ReturningValues returning_;
  std::vector<kernels::ReturnRay> rays_;
  bool prepared_ = false;
  bool knows_space_ = false;      ///< nobody else changed the grid since
  kernels::GridSpace space_;      ///< of the device's grid
  std::mutex asking_;             ///< of what readWeightsAt() uses
  std::mutex mutex_;              ///< of the mirror's topology, and of what follows
  std::deque<Growth> growths_;    ///< of the scans that the host's map has not got yet
  std::uint64_t held_bytes_ = 0;  ///< when the host's map got the latest scan
  std::unique_ptr<kernels::ScanFuser> fuser_;
  MapFollower::Scan scan_;  ///< its memory is reused
  MapFollower follower_;    ///< the last member: destroyed first, it waits for the host's map
};

}  // namespace accessvdb::internal
