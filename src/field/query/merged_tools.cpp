// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/merged_tools.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

#include "accessvdb/tool_spec.h"
#include "field/query/withheld.h"
#include "field/tools/best_tool.h"

namespace accessvdb::internal {
namespace {

struct ToolState {
  std::vector<std::uint16_t> score, direction;
  std::vector<float> stability;
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;
  std::vector<std::uint8_t> roll;  ///< 0 if the tool does not roll

  ToolState(kernels::Backend& backend, const PointScorer& scorer, std::size_t size) {
    const kernels::PointStateView view = scorer.device().view();
    const auto fetch = [&](auto& to, const auto* from) {
      to.resize(size);
      if (size > 0) backend.download(to.data(), from, size * sizeof(to[0]));
    };
    fetch(score, view.score);
    fetch(direction, view.direction);
    fetch(stability, view.stability);
    fetch(label, view.label);
    fetch(reason, view.reason);
    ToldPoints{label, reason, score, direction}.withhold({{}, scorer.waiting()});
    if (view.roll != nullptr) {
      fetch(roll, view.roll);
    } else {
      roll.assign(size, 0);
    }
  }
};

std::vector<float> axesOf(const kernels::ApproachView& approach) {
  std::vector<float> axes;
  for (int d = 0; d < approach.num_directions; ++d) {
    if (approach.axes_xyz != nullptr) {
      axes.insert(axes.end(), approach.axes_xyz + 3 * d, approach.axes_xyz + 3 * d + 3);
    } else {
      axes.insert(axes.end(), {approach.direction_xy[2 * d], approach.direction_xy[2 * d + 1], 0.0f});
    }
  }
  return axes;
}

bool rolls(const ViewedTool& tool) { return tool.scorer.device().view().roll != nullptr; }

}  // namespace

MergedTools::MergedTools(kernels::Backend& backend, std::span<const ViewedTool> tools)
    : memory_(backend), arrays_(memory_, tools.front().scorer.device().size(), std::ranges::any_of(tools, rolls)) {
  const std::size_t size = tools.front().scorer.device().size();
  std::vector<ToolState> states;
  std::vector<int> first_direction;
  std::vector<float> axes;
  for (const ViewedTool& tool : tools) {
    states.emplace_back(backend, tool.scorer, size);
    first_direction.push_back(num_directions_);
    num_directions_ += tool.approach.num_directions;
    const std::vector<float> more = axesOf(tool.approach);
    axes.insert(axes.end(), more.begin(), more.end());
  }
  ToolState& merged = states.front();  // each point is read from all tools before it is written
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, size, 1024), [&](const auto& range) {
    std::array<ToolVerdict, kMostTools> verdicts;
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      for (std::size_t k = 0; k < tools.size(); ++k) {
        verdicts[k] = {states[k].label[n], states[k].reason[n], states[k].score[n], tools[k].collision_limit,
                       tools[k].grown};
      }
      const std::size_t best = bestTool(std::span(verdicts).first(tools.size()));
      const ToolState& from = states[best];
      merged.score[n] = from.score[n];
      merged.stability[n] = from.stability[n];
      merged.label[n] = from.label[n];
      merged.reason[n] = from.reason[n];
      merged.roll[n] = from.roll[n];
      const std::uint16_t d = from.direction[n];
      merged.direction[n] = d == kNoDirection ? d : static_cast<std::uint16_t>(d + first_direction[best]);
    }
  });
  d_axes_ = kernels::DeviceArray<float>(memory_, axes.size());
  d_axes_.upload(axes.data(), axes.size());
  const auto upload = [size](const auto& host, auto& array) { array.upload(host.data(), size); };
  upload(merged.score, arrays_.score);
  upload(merged.direction, arrays_.direction);
  upload(merged.stability, arrays_.stability);
  upload(merged.label, arrays_.label);
  upload(merged.reason, arrays_.reason);
  if (arrays_.roll.size() > 0) upload(merged.roll, arrays_.roll);
  view_ = arrays_.in(tools.front().scorer.device().view());
}

}  // namespace accessvdb::internal
