// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The CPU backend: runs the rules of hostdev/ under TBB. Has no rules of its own and no OpenVDB.
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <cmath>
#include <cstring>
#include <new>
#include <optional>
#include <type_traits>
#include <vector>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "cpu/map_window.h"
#include "hostdev/place_key.h"
#include "launch/backend.h"

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

/// Tests directions with the bits around a point's group. @tparam Request  ScoreRequest or DueRequest
template <class Request>
struct WindowTests {
  MapWindow& window;
  const Request& request;
  const float* position_L;
  Coord point_ijk;

  [[nodiscard]] ArmResult arm(int d) const {
    return window.testArm(request.approach, d, position_L, request.map.inverse_voxel_size);
  }
  [[nodiscard]] int collisions(int d, int stop_above) const {
    return request.tool.use_samples
               ? window.countSamples(request.tool, d, position_L, request.map.inverse_voxel_size, stop_above)
               : window.countVoxels(d, point_ijk, stop_above);
  }
};

/// An item with the place of its group.
struct PlacedItem {
  std::uint64_t group;
  std::uint32_t index;
};

template <class Request>
const float* positionOf(const Request& request, std::size_t n) {
  return request.points.position_L + 3 * std::size_t{request.items[n].id};
}
template <class Request>
Coord voxelOfItem(const Request& request, std::size_t n) {
  const float* p = positionOf(request, n);
  return voxelOf(p[0], p[1], p[2], request.map.inverse_voxel_size);
}

/// Items in the order of their groups.
template <class Request>
std::vector<PlacedItem> byGroup(const Request& request, const WindowShape& shape) {
  std::vector<PlacedItem> placed(request.count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const Coord ijk = voxelOfItem(request, n);
      const int xy = 3 + shape.xy_log2, z = 3 + shape.z_log2;
      placed[n] = {placeKey(ijk[0] >> xy, ijk[1] >> xy, ijk[2] >> z), static_cast<std::uint32_t>(n)};
    }
  });
  tbb::parallel_sort(placed.begin(), placed.end(), [](const PlacedItem& a, const PlacedItem& b) {
    return a.group != b.group ? a.group < b.group : a.index < b.index;
  });
  return placed;
}

/// Calls visit(n, tests) for each item. @tparam Visit  takes any kind of tests
template <class Request, class Visit>
void forEachByRows(const Request& request, const Visit& visit) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, kItemsPerTask), [&](const auto& range) {
    const OccupancyReader map(request.map);
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      visit(n, MapTests{map, request.tool, request.approach, positionOf(request, n), request.map.inverse_voxel_size});
    }
  });
}
template <class Request, class Visit>
void forEachByWindows(const Request& request, const WindowedTool& tool, const Visit& visit) {
  const std::vector<PlacedItem> placed = byGroup(request, tool.shape());
  std::vector<std::size_t> begin;
  for (std::size_t n = 0; n < placed.size(); ++n) {
    if (n == 0 || placed[n].group != placed[n - 1].group || n - begin.back() >= kItemsPerWindow) begin.push_back(n);
  }
  begin.push_back(placed.size());
  tbb::enumerable_thread_specific<MapWindow> windows([&] { return MapWindow(tool); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, begin.size() - 1), [&](const auto& range) {
    const OccupancyReader map(request.map);
    MapWindow& window = windows.local();
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      const Coord first = voxelOfItem(request, placed[begin[g]].index);
      window.moveTo(map, Coord(first[0] >> 3, first[1] >> 3, first[2] >> 3));
      for (std::size_t at = begin[g]; at < begin[g + 1]; ++at) {
        const std::size_t n = placed[at].index;
        visit(n, WindowTests<Request>{window, request, positionOf(request, n), voxelOfItem(request, n)});
      }
    }
  });
}
template <class Request, class Visit>
void forEachItem(const Request& request, const Visit& visit) {
  if (request.count == 0) return;
  std::optional<WindowedTool> made;
  const auto* tool = static_cast<const WindowedTool*>(request.prepared);
  if (tool == nullptr) tool = &made.emplace(request.tool, request.approach, request.map.inverse_voxel_size);
  if (tool->usable()) {
    forEachByWindows(request, *tool, visit);
  } else {
    forEachByRows(request, visit);
  }
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
        const SearchedPoint point = {normal_L, seen, nearestByYaw(request.approach, normal_L)};
        result = searchDirections(tests, request.tool.collision_limit, request.approach, point, item);
      }
      updatePoint(points, item, result, request.rule);
    });
  }

  void evaluateDue(const DueRequest& request) override {
    forEachItem(request, [&](std::size_t n, const auto& tests) {
      using Evaluation = DueEvaluation<std::remove_cvref_t<decltype(tests)>>;
      const DueItem& item = request.items[n];
      const int nearest = nearestByYaw(request.approach, request.points.normal_L + 3 * std::size_t{item.id});
      const typename Evaluation::Update update = {request.approach, request.points, request.rule, request.scale};
      request.outcomes[n] = Evaluation(update, tests, item.known, item.id, nearest).run(item.due);
    });
  }
};

}  // namespace

std::unique_ptr<Backend> makeCpuBackend() { return std::make_unique<CpuBackend>(); }

}  // namespace accessvdb::kernels
