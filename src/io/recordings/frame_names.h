// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Names of frames in recordings, and which of them the clouds are in.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "io/poses/frame_links.h"
#include "io/recordings/recording_index.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {

[[nodiscard]] inline std::string frameText(const std::string& name) {
  return name.empty() || name.front() == '\n' ? "without a name" : wordForMessage(name);
}

/// The frame of most clouds, the first of several; not one that does not move.
template <typename IsFixed>
[[nodiscard]] std::optional<std::string> mostUsedFrame(const IndexedTopic& cloud, const IsFixed& isFixed) {
  std::vector<std::size_t> used(cloud.frames.size());
  for (const IndexedCloud& one : cloud.clouds) ++used[one.frame];
  std::optional<std::size_t> most;
  for (std::size_t frame = 0; frame < used.size(); ++frame)
    if (!isFixed(cloud.frames[frame]) && (!most || used[frame] > used[*most])) most = frame;
  if (!most) return std::nullopt;
  return cloud.frames[*most];
}

}  // namespace accessvdb::io
