// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Publishes the messages of a recording as they are: what was recorded is heard as if it happened now.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

namespace accessvdb::dds {

struct ReplayOptions {
  std::filesystem::path recording = {};  ///< .mcap, .db3 or a folder of parts, of ROS 2
  int domain = 0;
  bool network = false;
  double rate = 1;     ///< times as fast as it was recorded; 0 = as fast as it is heard
  double wait_s = 30;  ///< at most so long for somebody who listens to a topic with clouds
  std::function<bool()> stopped = [] { return false; };
};

/// Clouds, poses, transforms and IMUs.
/// @return how many messages were published, and all were heard that somebody listened to reliably
/// @throws InputError, UnusableInput "replay.nothing", ResourceLimit "dds.participant", "replay.nobody"
std::uint64_t replay(const ReplayOptions& options);

}  // namespace accessvdb::dds
