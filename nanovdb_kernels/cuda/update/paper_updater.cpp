// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy on the GPU: a queue of points, the neighbourhoods of those whose turn it is, and their scores. It
/// evaluates the same points at the same updates as the CPU (src/update/paper_on_host.cpp), with the same kernels that
/// score what the host requests.
#include <algorithm>
#include <utility>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/staging.h"
#include "cuda/search/score_kernels.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/paper_kernels.h"
#include "cuda/update/point_tables.h"
#include "cuda/update/update_kernels.h"
#include "cuda/update/updaters.h"
#include "cuda/update/work_queue.h"
#include "launch/counted_memory.h"
#include "launch/queue_age.h"
#include "launch/stopwatch.h"

namespace accessvdb::kernels {
namespace {

class DevicePaperUpdater final : public PaperUpdater {
 public:
  DevicePaperUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const PaperTables& tables)
      : context_(std::move(context)),
        memory_(memory),
        candidates_(tables.candidates),
        counters_(memory_, stream()),
        points_(context_, memory_, tables.neighbours, false),
        queue_(memory_) {}

  void admit(const AdmitInput& input) override {
    const CurrentDevice current(context_->device());
    points_.grow(input, stream());
    queue_.grow(input.num_points, stream());
    points_.admit(input, {}, {}, kNoIndex, stream());
  }

  UpdateOutcome update(const ScoringInput& input, const ConfidenceDelta& confidence,
                       const TriggeredPoints& triggered) override {
    const CurrentDevice current(context_->device());
    points_.setState(input.tools.front().points);
    points_.setWeights(confidence.weights, stream());
    points_.setWeights(confidence.crossed, stream());  // the returns that count may be their neighbours'
    counters_.clear(stream());
    const std::uint32_t before = queue_.size();
    enqueue(confidence.crossed, triggered);
    const std::uint32_t budget = input.budget_points,
                        turn = budget > 0 ? std::min(queue_.size(), budget) : queue_.size();
    age_.note(queue_.size() - before, turn);
    ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), context_->mirrorReady()));
    UpdateOutcome outcome;
    if (turn > 0) evaluate(input, turn, outcome);
    const UpdateCounters done = counters_.read(stream());
    queue_.drop(turn, stream());
    requireNeighbours(done.moved);
    any_resolved_ = any_resolved_ || done.resolved > 0;  // best scores never rise, so this stays true
    outcome.evaluated = turn;
    outcome.scored = done.outcome.scored;
    outcome.tests = done.outcome.tests;
    outcome.label_changes = done.outcome.label_changes;
    outcome.waiting = queue_.size();
    outcome.waiting_updates = age_.updates();
    WorkQueue::Left left = queue_.left(input.tools.front().points.label, stream());
    outcome.withheld = left.accessible;
    outcome.waiting_ids.push_back(std::move(left.ids));
    return outcome;
  }

  std::uint64_t bytes() const override { return memory_.bytes() + points_.mappedBytes(); }

 private:
  [[nodiscard]] cudaStream_t stream() const { return context_->stream(); }

  /// Adds points in the order of paper_on_host.cpp.
  void enqueue(std::span<const PointWeight> crossed_points, const TriggeredPoints& triggered) {
    const auto crossed = static_cast<std::uint32_t>(crossed_points.size());
    confident_.growWithRoom(memory_, crossed, roomFor(crossed), 0);
    launchSetConfident(queue_.flags(), crossed_.send(crossed_points, memory_, stream()), confident_.data(), stream());
    constexpr std::uint8_t kMask = kConfidentPoint | kWaiting, kValue = kConfidentPoint;
    queue_.addFromList({confident_.data(), crossed}, {kMask, kValue}, stream());
    for (const std::span<const std::uint32_t> ids : {triggered.jumped, triggered.sampled}) {
      queue_.addFromList(asked_.send(ids, memory_, stream()), {kMask, kValue}, stream());
    }
    const PointsView& points = points_.view();
    if (triggered.all_blocked) queue_.addFrom(points.num_points, {kMask, kValue, points.points.label}, stream());
  }

  /// Evaluates the first `turn` points of the queue.
  void evaluate(const ScoringInput& input, std::uint32_t turn, UpdateOutcome& outcome) {
    growTurn(turn);
    const bool with_hints = candidates_.on && any_resolved_;
    if (with_hints) findHints(turn, input.tools.front().rule.collision_limit);
    std::uint32_t* const failed = &counters_.data()->moved.failed;
    for (std::uint32_t first = 0, part = 0; first < turn; first += part) {
      part = std::min(turn - first, PointTables::kChunk);
      PaperTurn of_part;
      of_part.count = part;
      of_part.ids = queue_.ids() + first;
      of_part.neighbourhoods = points_.makeNeighbourhoods({queue_.ids(), nullptr, first, part}, failed, stream());
      of_part.hints = with_hints ? hints_.data() + first : nullptr;
      of_part.items = items_.data();
      of_part.results = results_.data();
      of_part.labels_before = labels_before_.data();
      of_part.flags = queue_.flags();
      launchTakeTurn(points_.view(), candidates_, of_part, stream());
      ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
      const Stopwatch scoring;
      score(input, of_part);
      ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
      outcome.score_ms += scoring.milliseconds();
    }
  }

  void score(const ScoringInput& input, const PaperTurn& turn) {
    const ToolInput& tool = input.tools.front();
    ScoreChunk chunk;
    chunk.map = input.map;
    chunk.tool = tool.tool;
    chunk.approach = tool.approach;
    chunk.points = tool.points;
    chunk.rule = tool.rule;
    chunk.items = turn.items;
    chunk.results = turn.results;
    chunk.count = turn.count;
    std::size_t scratch_bytes = order_scratch_.size();
    std::uint32_t* const lists = order_.data();
    launchLeafOrder(chunk, lists, lists + turn.count, lists + 2 * turn.count, lists + 3 * turn.count,
                    order_scratch_.data(), scratch_bytes, stream());
    chunk.order = lists + 3 * turn.count;
    launchWarpSearch(chunk, planWindow(tool.tool, context_->sharedBytesPerBlock(), true), stream());
    launchUpdate(chunk, stream());
    launchTallyTurn(turn, tool.rule.collision_limit, counters_.data(), stream());
  }

  /// Makes room to evaluate this many points, part by part.
  void growTurn(std::uint32_t turn) {
    if (candidates_.on) hints_.growWithRoom(memory_, turn, roomFor(turn), 0);
    const std::uint32_t part = std::min(turn, PointTables::kChunk);
    points_.growChunks(part);
    const auto grow = [&](auto& array, std::size_t each) {
      array.growWithRoom(memory_, each * part, each * std::min<std::size_t>(roomFor(part), PointTables::kChunk), 0);
    };
    grow(items_, 1);
    grow(results_, 1);
    grow(labels_before_, 1);
    grow(order_, 4);
    ScoreChunk chunk;
    chunk.count = part;
    std::size_t bytes = 0;
    launchLeafOrder(chunk, nullptr, nullptr, nullptr, nullptr, nullptr, bytes, nullptr);
    order_scratch_.growWithRoom(memory_, bytes, roomFor(bytes), 0);
  }

  /// Finds hints for the whole turn: all points see what was known before the first is evaluated.
  void findHints(std::uint32_t turn, std::uint16_t collision_limit) {
    for (std::uint32_t first = 0; first < turn; first += PointTables::kChunk) {
      launchFindHints(points_.view(), {candidates_, collision_limit},
                      {queue_.ids() + first, std::min(turn - first, PointTables::kChunk)}, hints_.data() + first,
                      stream());
    }
  }

  std::shared_ptr<DeviceContext> context_;
  CountedMemory memory_;
  CoarseToFine candidates_;
  DeviceCounters counters_;
  PointTables points_;
  WorkQueue queue_;
  QueueAge age_;
  bool any_resolved_ = false;  ///< whether any point lends its direction
  Staging<PointWeight> crossed_;
  Staging<std::uint32_t> asked_;
  DeviceArray<std::uint32_t> confident_;  ///< points that became confident
  // For the points whose turn it is.
  DeviceArray<std::uint16_t> hints_;
  // For a part of them.
  DeviceArray<ScoreItem> items_;
  DeviceArray<ScoreResult> results_;
  DeviceArray<PointLabel> labels_before_;
  DeviceArray<std::uint32_t> order_;  ///< four lists, for launchLeafOrder
  DeviceArray<std::byte> order_scratch_;
};

}  // namespace

std::unique_ptr<PaperUpdater> makePaperUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                               const PaperTables& tables) {
  const CurrentDevice current(context->device());
  return std::make_unique<DevicePaperUpdater>(std::move(context), memory, tables);
}

}  // namespace accessvdb::kernels
