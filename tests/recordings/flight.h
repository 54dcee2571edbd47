// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A short flight along a line, turning: its scans as files, from which writers make recordings.
#pragma once

#include <Eigen/Geometry>
#include <cstdio>

#include "accessvdb/scan_io.h"
#include "io/recordings/recording_index.h"
#include "recordings/writers.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::recordings_test {

class FlightTest : public ::testing::Test {
 protected:
  static Eigen::Vector3f pointAt(std::size_t scan, std::size_t i) {
    return {2.0F + static_cast<float>(i) / 128, static_cast<float>(scan) / 4, -static_cast<float>(i % 7) / 8};
  }
  static Eigen::Vector3d sensorAt(std::size_t scan) { return {0.25 * static_cast<double>(scan), -1, 0.5}; }
  static Eigen::Quaterniond turnAt(std::size_t scan) {
    return Eigen::Quaterniond(1, 0.01 * static_cast<double>(scan), -0.02, 0.1).normalized();
  }
  static Eigen::Isometry3d poseOf(std::size_t scan) {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.linear() = turnAt(scan).normalized().toRotationMatrix();
    T_W_S.translation() = sensorAt(scan);
    return T_W_S;
  }

  void writeFlight(std::size_t scans, std::size_t points) const {
    std::string poses;
    for (std::size_t scan = 0; scan < scans; ++scan) {
      std::string pcd = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " +
                        std::to_string(points) + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " +
                        std::to_string(points) + "\nDATA binary\n";
      for (std::size_t i = 0; i < points; ++i)
        for (const float value : pointAt(scan, i)) io::test::put(pcd, value);
      char text[300];
      std::snprintf(text, sizeof text, "scans/%06zu.pcd", scan);
      folder_.write(text, pcd);
      const Eigen::Quaterniond q = turnAt(scan);
      const Eigen::Vector3d t = sensorAt(scan);
      std::snprintf(text, sizeof text, "%.1f %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n",
                    static_cast<double>(scan) / 10, t[0], t[1], t[2], q.x(), q.y(), q.z(), q.w());
      poses += text;
    }
    folder_.write("poses.txt", poses);
  }

  [[nodiscard]] fs::path write(const std::string& name, const std::string& options) const {
    fs::remove(folder_.path() / name);
    return writeRecording(folder_.path(), folder_.path() / name, options);
  }

  static void expectScan(const io::ScanRecord& record, std::size_t scan, std::size_t points) {
    ASSERT_EQ(record.points_S.size(), points);
    for (std::size_t i = 0; i < points; ++i) ASSERT_EQ(record.points_S[i], pointAt(scan, i)) << i;
    EXPECT_EQ(record.T_W_S.matrix(), poseOf(scan).matrix());
    EXPECT_NEAR(record.stamp_s, 1.7e9 + static_cast<double>(scan) / 10, 1e-6);  // a double has no more digits
  }

  static void expectFlight(const fs::path& recording, std::size_t count, std::size_t points) {
    io::ScanSequence scans = io::ScanSequence::open({.scans = recording});
    ASSERT_EQ(scans.size(), count) << recording;
    EXPECT_TRUE(scans.warnings().empty()) << recording << scans.warnings()[0].text;
    for (std::size_t step = 0; step < count; ++step) expectScan(scans.read(step), step, points);
  }

  static io::RecordingIndex indexOf(const fs::path& file, io::ScanKind kind) {
    std::vector<std::unique_ptr<bags::Recording>> recordings;
    recordings.push_back(io::openRecording(file, kind, false));
    return io::indexRecording({.files = {file}, .kind = kind}, recordings);
  }

  io::test::TempFolder folder_;
};

}  // namespace accessvdb::recordings_test
