// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/view_layer.h"

#include <limits>

#include "report/result_text.h"

namespace accessvdb::internal {
namespace {

constexpr const char* kViewsVerb = "views";
/// Farther away the page, whose numbers are floats, draws nothing.
constexpr double kFarthestView_m = 1e9;

nlohmann::ordered_json viewOf(const ResultText& text) {
  constexpr double kAny = std::numeric_limits<double>::max();
  const ResultText pose = text.at("pose");
  for (const ResultText& number : pose.at("position").list()) (void)number.number(-kFarthestView_m, kFarthestView_m);
  return {{"pose", pose.pose()},
          {"resolves", text.at("resolves").number(0, kAny)},
          {"of_confidence", text.at("of_confidence").number(0, kAny)},
          {"of_unseen", text.at("of_unseen").number(0, kAny)},
          {"of_unknown", text.at("of_unknown").number(0, kAny)},
          {"travel_m", text.at("travel_m").number(0, kAny)},
          {"way_is_free", text.at("way_is_free").yesOrNo()}};
}

}  // namespace

ViewLayer::ViewLayer(const std::filesystem::path& path) : file_(resultFile(path, kViewsVerb)) {
  readResult(file_, kViewsVerb, [&](const ResultText& text) {
    constexpr std::uint64_t kMany = std::numeric_limits<std::uint32_t>::max();  // of each, so that their sum is right
    for (const char* reason : {"confidence", "unseen", "unknown"})
      unresolved_ += text.at("unresolved_points").at(reason).count(kMany);
    shown_ = {{"unresolved_points", unresolved_}, {"views", nlohmann::ordered_json::array()}};
    for (const ResultText& each : text.at("views").list()) shown_["views"].push_back(viewOf(each));
  });
}

std::optional<std::string> ViewLayer::warning(const std::array<std::uint64_t, kNumPointReasons>& points) const {
  std::uint64_t of_map = 0;
  for (const PointReason reason : {PointReason::Confidence, PointReason::Unseen, PointReason::Unknown})
    of_map += points[static_cast<std::size_t>(reason)];
  if (of_map == unresolved_) return std::nullopt;
  return "views are for " + std::to_string(unresolved_) + " unresolved points, and the map has " +
         std::to_string(of_map) + ": they are of another map, or it has changed since";
}

}  // namespace accessvdb::internal
