// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writers of recordings that share no code with the project: npm packages under node, and Debian's python3-rosbag.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace accessvdb::recordings_test {

namespace fs = std::filesystem;

inline fs::path npmFolder() { return fs::path(ACCESSVDB_SOURCE_DIR) / "build" / "npm"; }
inline fs::path scriptFolder() { return fs::path(ACCESSVDB_SOURCE_DIR) / "tests" / "recordings"; }

inline bool runs(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

/// Missing packages skip a test, for machines without them; anything else that goes wrong fails it.
inline bool hasRos2Writer() {
  return fs::exists(npmFolder() / "node_modules" / "@mcap" / "core") && runs("command -v node") &&
         runs("command -v zstd") && runs("command -v lz4") && runs("command -v sqlite3");
}
inline bool hasRos1Writer() { return runs("/usr/bin/python3 -c 'import rosbag, nav_msgs, sensor_msgs, tf2_msgs'"); }

#define ACCESSVDB_NEED_ROS2_WRITER()                \
  if (!accessvdb::recordings_test::hasRos2Writer()) \
  GTEST_SKIP() << "node, @mcap/core, zstd, lz4 or sqlite3 is missing: tools/setup_debian.sh --tests"
#define ACCESSVDB_NEED_ROS1_WRITER()                \
  if (!accessvdb::recordings_test::hasRos1Writer()) \
  GTEST_SKIP() << "python3-rosbag is missing: tools/setup_debian.sh --tests"

/// @param folder   with scans/ and poses.txt
/// @param options  see write_ros2.mjs, write_ros1.py
inline fs::path writeRecording(const fs::path& folder, const fs::path& out, const std::string& options) {
  const std::string program =
      out.extension() == ".bag"
          ? "/usr/bin/python3 '" + (scriptFolder() / "write_ros1.py").string() + "'"
          : "node '" + (scriptFolder() / "write_ros2.mjs").string() + "' '" + npmFolder().string() + "'";
  const std::string command = program + " '" + folder.string() + "' '" + out.string() + "' " + options;
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  return out;
}

}  // namespace accessvdb::recordings_test
