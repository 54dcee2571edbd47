// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/merged_tools.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

#include "accessvdb/tool_spec.h"
#include "field/best_tool.h"

namespace accessvdb::internal {
namespace {

struct ToolState {
  std::vector<std::uint16_t> score, direction;
  std::vector<float> stability;
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;
  std::vector<std::uint8_t> roll;  ///< 0 if the tool does not roll

  ToolState(kernels::Backend& backend, const kernels::PointStateView& view, std::size_t size) {
    const auto fetch = [&](auto& to, const auto* from) {
      to.resize(size);
      if (size > 0) backend.download(to.data(), from, size * sizeof(to[0]));
    };
    fetch(score, view.score);
    fetch(direction, view.direction);
    fetch(stability, view.stability);
    fetch(label, view.label);
    fetch(reason, view.reason);
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

template <typename T>
void keep(kernels::DeviceMemory& memory, const std::vector<T>& host, kernels::DeviceArray<T>& array) {
  if (host.empty()) return;
  array = kernels::DeviceArray<T>(memory, host.size());
  array.upload(host.data(), host.size());
}

}  // namespace

MergedTools::MergedTools(kernels::Backend& backend, std::span<const ViewedTool> tools)
    : memory_(backend), view_(tools.front().scorer.device().view()) {
  const std::size_t size = tools.front().scorer.device().size();
  std::vector<ToolState> states;
  std::vector<int> first_direction;
  std::vector<float> axes;
  bool rolls = false;
  for (const ViewedTool& tool : tools) {
    rolls = rolls || tool.scorer.device().view().roll != nullptr;
    states.emplace_back(backend, tool.scorer.device().view(), size);
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
        verdicts[k] = {states[k].label[n], states[k].reason[n], states[k].score[n], tools[k].collision_limit};
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
  keep(memory_, axes, d_axes_);
  keep(memory_, merged.score, score_);
  keep(memory_, merged.direction, direction_);
  keep(memory_, merged.stability, stability_);
  keep(memory_, merged.label, label_);
  keep(memory_, merged.reason, reason_);
  if (rolls) keep(memory_, merged.roll, roll_);
  view_.score = score_.data();
  view_.direction = direction_.data();
  view_.stability = stability_.data();
  view_.label = label_.data();
  view_.reason = reason_.data();
  view_.roll = roll_.data();
}

}  // namespace accessvdb::internal
