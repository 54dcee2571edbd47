// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend provides: memory, the mirror's address range, and the two operations on point state. The rules
/// themselves are in hostdev/; a backend only decides which thread runs them on which point.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "hostdev/direction_search.h"
#include "hostdev/point_input.h"
#include "hostdev/point_update.h"
#include "hostdev/told_state.h"
#include "hostdev/views.h"
#include "launch/device_array.h"
#include "launch/due_evaluator.h"
#include "launch/exact_updater.h"
#include "launch/mirror_arena.h"
#include "launch/paper_updater.h"
#include "launch/scan_fuser.h"
#include "launch/tool_fits.h"

namespace accessvdb::kernels {

/// What a backend makes of the tool and the corridor once, so that it scores faster.
class PreparedTool {
 public:
  /// Of the tool's columns: beyond that, nothing is made of them.
  static constexpr std::uint64_t kMostColumnBytes = std::uint64_t{512} << 20;

  virtual ~PreparedTool() = default;
  [[nodiscard]] virtual std::uint64_t bytes() const = 0;  ///< in host memory
};

/// Scores `count` items: searches directions by the rules, updates the points' state, returns the results.
struct ScoreRequest {
  OccupancyView map;
  ToolKernelView tool;    ///< in the backend's memory
  ApproachView approach;  ///< in the backend's memory
  PointStateView points;  ///< in the backend's memory
  UpdateRule rule;
  const PreparedTool* prepared = nullptr;  ///< of `tool`, `approach` and the map's voxel size; null: not prepared
  const ScoreItem* items = nullptr;        ///< [count] host memory; ids differ
  ScoreResult* results = nullptr;          ///< [count] host memory
  std::size_t count = 0;
};

/// Calls return once their effect is visible to the host.
class Backend : public DeviceMemory {
 public:
  [[nodiscard]] virtual std::string name() const = 0;  ///< "cpu" or "cuda:NAME"
  /// Peak device memory held at one time, as tracked by us; 0 on the CPU.
  [[nodiscard]] virtual std::uint64_t peakBytes() const { return 0; }
  /// Device memory held now, mirrors included; 0 on the CPU.
  [[nodiscard]] virtual std::uint64_t heldBytes() const { return 0; }
  /// Device memory that nobody holds now; 0 on the CPU.
  [[nodiscard]] virtual std::uint64_t freeBytes() const { return 0; }
  /// Host memory held for transfers of mirrors and scores; 0 on the CPU.
  [[nodiscard]] virtual std::uint64_t pinnedBytes() const { return 0; }
  [[nodiscard]] virtual std::unique_ptr<MirrorArena> makeArena() = 0;
  /// Returns once any reader can read what the mirror's arena flushed.
  virtual void waitForMirror() {}
  /// Whether the state arrays are in host memory, where the host may write the seen directions of a wide set itself.
  [[nodiscard]] virtual bool hasHostMemory() const { return false; }
  /// Writes what the host knows into the state arrays: position, normal, seen, weight; of a wide set all but seen.
  virtual void writePoints(const PointStateView& points, const PointInput* inputs, std::size_t count) = 0;
  /// Writes the seen directions of points of a wide set. @param rows  [count x PointStateView::direction_words]
  virtual void writeSeen(const PointStateView& points, const std::uint32_t* ids, const std::uint64_t* rows,
                         std::size_t count) = 0;
  /// Reads the state of some points. @param ids  [count]  @param rows  [count] out
  virtual void readPoints(const PointStateView& points, const std::uint32_t* ids, StateRow* rows,
                          std::size_t count) = 0;
  /// takeTold() of all points. @param states  in the backend's memory
  virtual void takeAllTold(const PointStateView& points, const ToldStates& states) = 0;
  virtual void scorePoints(const ScoreRequest& request) = 0;
  virtual void fitTool(const FitRequest& request) = 0;
  /// Only called if makeExactUpdater() gave null.
  [[nodiscard]] virtual std::unique_ptr<DueEvaluator> makeDueEvaluator(const DueUpdate& update) {
    (void)update;
    return nullptr;
  }
  /// Null if this backend needs nothing of the kind. @param tool, approach  in the backend's memory; must outlive it
  [[nodiscard]] virtual std::unique_ptr<PreparedTool> prepareTool(const ToolKernelView& tool,
                                                                  const ApproachView& approach,
                                                                  float inverse_voxel_size) {
    (void)tool, (void)approach, (void)inverse_voxel_size;
    return nullptr;
  }
  /// Whether its updater uses the slabs of the tool (ScoringInput::slabs).
  [[nodiscard]] virtual bool usesToolSlabs() const { return false; }
  /// Null if the host decides what is due (src/update/exact_on_host.cpp). Must not outlive the backend.
  [[nodiscard]] virtual std::unique_ptr<ExactUpdater> makeExactUpdater(const ExactTables& tables) {
    (void)tables;
    return nullptr;
  }
  /// Null if scans are fused on the host. @param grid  a mirror of facts in an arena of this backend, empty
  [[nodiscard]] virtual std::unique_ptr<ScanFuser> makeScanFuser(const FusionSetting& setting,
                                                                 const OccupancyGrid* grid) {
    (void)setting, (void)grid;
    return nullptr;
  }
  /// The same for the paper's policy (src/update/paper_on_host.cpp).
  [[nodiscard]] virtual std::unique_ptr<PaperUpdater> makePaperUpdater(const PaperTables& tables) {
    (void)tables;
    return nullptr;
  }
};

/// Runs the rules under TBB on host memory.
[[nodiscard]] std::unique_ptr<Backend> makeCpuBackend();
/// Runs the rules on an NVIDIA GPU; only in builds with ACCESSVDB_HAS_CUDA.
/// @throw DeviceError  no driver, no device, old driver, wrong architecture, or no memory to start with
[[nodiscard]] std::unique_ptr<Backend> makeCudaBackend();

}  // namespace accessvdb::kernels
