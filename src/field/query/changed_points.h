// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points of a field are not what they were when they were last asked for.
///
/// Not all points are looked at for that: the backend compares the states in its own memory, and only points for which
/// these, or what withholds them, are others than before are read, with their weights (docs/design/live.md, "Changes
/// are found by comparing").
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/surface_points.h"
#include "launch/backend.h"
#include "launch/counted_memory.h"
#include "points/points_as_told.h"

namespace accessvdb::internal {

struct FieldStages;
class PointScorer;

/// For one thread at a time, as the field.
class ChangedPoints {
 public:
  /// @param backend  must outlive this  @param several  tools
  ChangedPoints(kernels::Backend& backend, bool several) : memory_(backend), several_(several), told_(several) {}

  /// Only where the field's last update has ended. @param field  the same every time
  /// @return points that are new since the call before, or whose label, reason, direction or tools changed, by id. If
  ///         this throws, the next call has them
  [[nodiscard]] std::vector<SurfacePoint> take(const FieldStages& field);
  /// The states of points were made anew: all of them are compared the next time.
  void compareAll() { compares_all_ = made_anew_ = true; }
  /// Whether they were since take(): there may be something to tell.
  [[nodiscard]] bool madeAnew() const { return made_anew_; }
  [[nodiscard]] bool comparesAll() const { return compares_all_; }
  [[nodiscard]] std::uint64_t hostBytes() const;
  [[nodiscard]] std::uint64_t deviceBytes() const { return memory_.bytes(); }

 private:
  /// What of a tool was told.
  struct OfTool {
    kernels::DeviceArray<kernels::ToldState> states;
    std::uint32_t known = 0;  ///< so many of them
    std::vector<std::uint8_t> waiting;
  };

  void takeOthers(const FieldStages& field);
  void sortOthers(const FieldStages& field);
  void takeOtherStates(const PointScorer& scorer, OfTool& of);
  [[nodiscard]] bool noteTaken(bool all);

  kernels::CountedMemory memory_;
  bool several_;
  bool compares_all_ = true, made_anew_ = false;
  std::vector<OfTool> tools_;
  kernels::DeviceArray<std::uint64_t> differ_;
  std::vector<std::uint64_t> differ_on_host_;
  std::vector<std::uint8_t> withheld_;  ///< by id; later ones were not
  PointsAsTold told_;
  /// Points that were taken out of the map and have no label, by id, without those that are told as withheld: their
  /// states do not say whether there is something again.
  std::vector<std::uint32_t> taken_;
  std::vector<std::uint32_t> others_;  ///< by id: those that may be told otherwise; its memory is reused
};

}  // namespace accessvdb::internal
