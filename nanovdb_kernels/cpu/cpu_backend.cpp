// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The CPU backend: runs the rules of hostdev/ under TBB. Has no rules of its own and no OpenVDB.
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>
#include <optional>
#include <type_traits>
#include <vector>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "cpu/map_window.h"
#include "cpu/tool_rows.h"
#include "hostdev/place_key.h"
#include "hostdev/wide_search.h"
#include "launch/backend.h"
#include "launch/due_update.h"

namespace accessvdb::kernels {
namespace {

/// Items per task, for tools without a window: a blocked point costs up to a millisecond, a free one a microsecond.
constexpr std::size_t kItemsPerTask = 32;
/// Items that share a window; more are divided among threads.
constexpr std::size_t kItemsPerWindow = 512;

/// DirectionWalk::nearestDirection without trying all: directions are equidistant in yaw, so only those beside the
/// normal's yaw can have the largest cosine, by far more than rounding.
int nearestByYaw(const ApproachView& approach, const float* normal) {
  constexpr int kFewDirections = 8;
  constexpr float kSteep = 1e-6f;  // horizontal part of a normal whose cosines might round to the same number
  const int directions = approach.num_directions;
  if (directions < kFewDirections || !(std::abs(normal[0]) + std::abs(normal[1]) > kSteep)) {
    return DirectionWalk::nearestDirection(approach, normal);
  }
  constexpr float kTurn = 6.283185307f;
  const float yaw = std::atan2(normal[1], normal[0]) / kTurn * static_cast<float>(directions);
  const int middle = static_cast<int>(std::lround(yaw)) + directions;
  int nearest = -1;
  float best = 0;
  for (int n = middle - 1; n <= middle + 1; ++n) {
    const int d = n % directions;
    const float cosine = cosToNormal(approach, d, normal);
    if (nearest < 0 || ranksBefore(cosine, d, best, nearest)) nearest = d, best = cosine;
  }
  return nearest;
}

/// Tests directions with the bits around a point. @tparam Inputs  ScoreRequest or DueUpdate
template <class Inputs>
struct WindowTests {
  MapWindow& window;  ///< stands at the point
  const Inputs& inputs;

  [[nodiscard]] ArmResult arm(int d) const { return window.testArm(inputs.approach, d); }
  [[nodiscard]] AxisCount collisions(int d, int stop_above) const {
    return countAxis(inputs.tool.parts, d, stop_above, [&](int part, int stop) {
      return inputs.tool.use_samples ? window.countSamples(inputs.tool, part, stop) : window.countVoxels(part, stop);
    });
  }
};

/// The tool as windows need it: as it was prepared, or made now.
class ToolForWindows {
 public:
  template <class Inputs>
  explicit ToolForWindows(const Inputs& inputs) : tool_(static_cast<const WindowedTool*>(inputs.prepared)) {
    if (tool_ == nullptr) tool_ = &made_.emplace(inputs.tool, inputs.approach, inputs.map.inverse_voxel_size);
  }
  ToolForWindows(const ToolForWindows&) = delete;
  ToolForWindows& operator=(const ToolForWindows&) = delete;

  [[nodiscard]] const WindowedTool& operator*() const { return *tool_; }

 private:
  std::optional<WindowedTool> made_;
  const WindowedTool* tool_;
};

template <class Inputs>
const float* positionOf(const Inputs& inputs, std::uint32_t id) {
  return inputs.points.position_L + 3 * std::size_t{id};
}
template <class Inputs>
Coord voxelOfPoint(const Inputs& inputs, std::uint32_t id) {
  const float* p = positionOf(inputs, id);
  return voxelOf(p[0], p[1], p[2], inputs.map.inverse_voxel_size);
}

/// Items [begin, end) with the place of their window.
struct PlacedItems {
  std::uint64_t window;
  std::uint32_t begin, end;

  [[nodiscard]] bool operator<(const PlacedItems& other) const {
    return window != other.window ? window < other.window : begin < other.begin;
  }
};

template <class Inputs>
std::uint64_t windowOf(const Inputs& inputs, const WindowBox& shape, std::uint32_t id) {
  const Coord ijk = voxelOfPoint(inputs, id);
  const int xy = 3 + shape.xy_log2, z = 3 + shape.z_log2;
  return placeKey(ijk[0] >> xy, ijk[1] >> xy, ijk[2] >> z);
}

/// Calls visit(n, tests) for items of one window after those of another.
template <class Inputs, class Item, class Visit>
void visitByWindow(const Inputs& inputs, const Item* items, const PlacedItems* begin, const PlacedItems* end,
                   MapWindow& window, const Visit& visit) {
  const OccupancyReader map(inputs.map);
  for (const PlacedItems* placed = begin; placed != end; ++placed) {
    if (placed == begin || placed->window != placed[-1].window) {
      const Coord first = voxelOfPoint(inputs, items[placed->begin].id);
      window.moveTo(map, Coord(first[0] >> 3, first[1] >> 3, first[2] >> 3));
    }
    for (std::size_t n = placed->begin; n != placed->end; ++n) {
      const std::uint32_t id = items[n].id;
      window.standAt(positionOf(inputs, id), voxelOfPoint(inputs, id), inputs.map.inverse_voxel_size);
      visit(n, WindowTests<Inputs>{window, inputs});
    }
  }
}

/// Calls visit(n, tests) for each item of a request, in parallel. @tparam Visit  takes any kind of tests
template <class Visit>
void forEachItem(const ScoreRequest& request, const Visit& visit) {
  if (request.count == 0) return;
  const ToolForWindows tool(request);
  if (!(*tool).usable()) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, kItemsPerTask), [&](const auto& range) {
      const OccupancyReader map(request.map);
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        visit(n, MapTests{map, request.tool, request.approach, positionOf(request, request.items[n].id),
                          request.map.inverse_voxel_size});
      }
    });
    return;
  }
  std::vector<PlacedItems> placed(request.count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const auto index = static_cast<std::uint32_t>(n);
      placed[n] = {windowOf(request, (*tool).shape(), request.items[n].id), index, index + 1};
    }
  });
  tbb::parallel_sort(placed);
  std::vector<std::size_t> begin;
  for (std::size_t n = 0; n < placed.size(); ++n) {
    if (n == 0 || placed[n].window != placed[n - 1].window || n - begin.back() >= kItemsPerWindow) begin.push_back(n);
  }
  begin.push_back(placed.size());
  tbb::enumerable_thread_specific<MapWindow> windows([&] { return MapWindow(*tool); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, begin.size() - 1), [&](const auto& range) {
    visitByWindow(request, request.items, placed.data() + begin[range.begin()], placed.data() + begin[range.end()],
                  windows.local(), visit);
  });
}

class CpuDueEvaluator final : public DueEvaluator {
 public:
  explicit CpuDueEvaluator(const DueUpdate& update)
      : update_(update), tool_(update_), scratch_([this] { return Scratch(*tool_); }) {}

  void evaluate(const DueTask* tasks, DueOutcome* outcomes, std::size_t count) override {
    const auto visit = [&](std::size_t n, const auto& tests) {
      using Evaluation = DueEvaluation<std::remove_cvref_t<decltype(tests)>, decltype(&nearestByYaw)>;
      constexpr std::size_t kAhead = 4;
      if (n + kAhead < count) prefetchPoint(tasks[n + kAhead].id);
      const DueTask& task = tasks[n];
      const typename Evaluation::Update constants = {update_.approach, update_.points, update_.rule, update_.scale,
                                                     &nearestByYaw};
      outcomes[n] = Evaluation(constants, tests, task.known, task.id).run(task.due);
    };
    if (!(*tool_).usable()) {
      const OccupancyReader map(update_.map);
      for (std::size_t n = 0; n < count; ++n) {
        visit(n, MapTests{map, update_.tool, update_.approach, positionOf(update_, tasks[n].id),
                          update_.map.inverse_voxel_size});
      }
      return;
    }
    Scratch& scratch = scratch_.local();
    std::vector<PlacedItems>& placed = scratch.placed;
    placed.clear();
    constexpr std::uint32_t kAhead = 8;
    for (std::uint32_t n = 0; n < count; ++n) {
      if (n + kAhead < count) prefetchPosition(tasks[n + kAhead].id);
      const std::uint64_t window = windowOf(update_, (*tool_).shape(), tasks[n].id);
      if (placed.empty() || placed.back().window != window) placed.push_back({window, n, n});
      placed.back().end = n + 1;
    }
    std::sort(placed.begin(), placed.end());
    visitByWindow(update_, tasks, placed.data(), placed.data() + placed.size(), scratch.window, visit);
  }

 private:
  struct Scratch {
    MapWindow window;
    std::vector<PlacedItems> placed;
    explicit Scratch(const WindowedTool& tool) : window(tool) {}
  };

  void prefetchPosition([[maybe_unused]] std::uint32_t id) const {
#if defined(__GNUC__)
    __builtin_prefetch(update_.points.position_L + 3 * std::size_t{id});
#endif
  }
  /// A point's state is scattered over arrays, and points over their length.
  void prefetchPoint([[maybe_unused]] std::uint32_t id) const {
#if defined(__GNUC__)
    const PointStateView& points = update_.points;
    const auto words = static_cast<std::size_t>(points.direction_words);
    prefetchPosition(id);
    __builtin_prefetch(points.normal_L + 3 * std::size_t{id});
    __builtin_prefetch(points.seen + words * id);
    __builtin_prefetch(points.score + id);
    __builtin_prefetch(points.direction + id);
    __builtin_prefetch(points.label + id);
    __builtin_prefetch(points.reason + id);
    __builtin_prefetch(points.stability + id);
#endif
  }

  DueUpdate update_;
  ToolForWindows tool_;
  tbb::enumerable_thread_specific<Scratch> scratch_;
};

template <typename Rows>
void fitEach(const FitRequest& request, const Rows& rows) {
  constexpr std::size_t kPosesPerTask = 16;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, kPosesPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n)
      request.fits[n] = toolFit(request.map, request.tool, request.places[n], request.enough, rows);
  });
}

class CpuBackend final : public Backend {
 public:
  std::string name() const override { return "cpu"; }

  std::unique_ptr<MirrorArena> makeArena() override { return std::make_unique<HostArena>(); }

  void* allocate(std::size_t bytes) override {
    void* address = ::operator new (bytes == 0 ? 1 : bytes, std::align_val_t{64}, std::nothrow);
    if (address == nullptr) {
      throw ResourceLimit("memory.points", "", "no memory for " + std::to_string(bytes) + " bytes of point state",
                          "Use a larger voxel size");
    }
    return address;
  }
  void release(void* address, std::size_t) noexcept override { ::operator delete (address, std::align_val_t{64}); }
  void upload(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void copy(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }

  void writePoints(const PointStateView& points, const PointInput* inputs, std::size_t count) override {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) writePoint(points, inputs[n]);
    });
  }

  bool hasHostMemory() const override { return true; }
  void writeSeen(const PointStateView& points, const std::uint32_t* ids, const std::uint64_t* rows,
                 std::size_t count) override {
    const auto words = static_cast<std::size_t>(points.direction_words);
    for (std::size_t n = 0; n < count; ++n) {
      std::copy_n(rows + words * n, words, points.seen + words * std::size_t{ids[n]});
    }
  }

  void readPoints(const PointStateView& points, const std::uint32_t* ids, StateRow* rows, std::size_t count) override {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) rows[n] = stateRowOf(points, ids[n]);
    });
  }
  void takeAllTold(const PointStateView& points, const ToldStates& states) override {
    tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, (states.count + 63) / 64, 64), [&](const auto& range) {
      for (std::uint32_t word = range.begin(); word != range.end(); ++word) {
        std::uint64_t differ = 0;
        for (std::uint32_t id = 64 * word; id < std::min(64 * word + 64, states.count); ++id) {
          differ |= static_cast<std::uint64_t>(takeTold(points, states, id)) << (id & 63);
        }
        states.differ[word] = differ;
      }
    });
  }

  std::unique_ptr<PreparedTool> prepareTool(const ToolKernelView& tool, const ApproachView& approach,
                                            float inverse_voxel_size) override {
    return std::make_unique<WindowedTool>(tool, approach, inverse_voxel_size);
  }

  void scorePoints(const ScoreRequest& request) override {
    const PointStateView& points = request.points;
    forEachItem(request, [&](std::size_t n, const auto& tests) {
      const ScoreItem& item = request.items[n];
      const float* normal_L = points.normal_L + 3 * std::size_t{item.id};
      ScoreResult& result = request.results[n];
      result = {};
      if (normal_L[0] != 0 || normal_L[1] != 0 || normal_L[2] != 0) {
        const std::uint64_t* seen =
            points.seen + std::size_t{item.id} * static_cast<std::size_t>(points.direction_words);
        if (isWide(request.approach.num_directions)) {
          result = searchWide(tests, request.approach, request.tool.collision_limit, normal_L, seen, item);
        } else if (request.approach.axes_xyz != nullptr) {
          SortedWalk walk(request.approach, normal_L);
          result = searchDirections(tests, request.tool.collision_limit, walk, seen, item);
        } else {
          DirectionWalk walk(request.approach, normal_L, nearestByYaw(request.approach, normal_L));
          result = searchDirections(tests, request.tool.collision_limit, walk, seen, item);
        }
      }
      updatePoint(points, item, result, request.rule);
    });
  }

  void fitTool(const FitRequest& request) override {
    if (const ToolRow row = fastToolRow(request.tool)) {
      fitEach(request, row);
    } else {
      fitEach(request, tool_fit::PlainRows());
    }
  }

  std::unique_ptr<DueEvaluator> makeDueEvaluator(const DueUpdate& update) override {
    return std::make_unique<CpuDueEvaluator>(update);
  }
};

}  // namespace

std::unique_ptr<Backend> makeCpuBackend() { return std::make_unique<CpuBackend>(); }

}  // namespace accessvdb::kernels
