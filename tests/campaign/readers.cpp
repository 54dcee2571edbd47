// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "campaign/readers.h"

#include <array>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/field_io.h"
#include "accessvdb/orientations.h"
#include "accessvdb/program/html_report.h"
#include "accessvdb/program/points_diff.h"
#include "accessvdb/program/recording_info.h"
#include "accessvdb/program/segment_file.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_geometry.h"

namespace accessvdb::campaign {
namespace {

namespace fs = std::filesystem;

void readAll(const io::ScanInputOptions& options) {
  io::ScanSequence scans = io::ScanSequence::open(options);
  for (std::size_t step = 0; step < scans.size(); ++step) (void)scans.read(step);
  (void)scans.heldBytes();
}

/// A cloud in the world frame, whole or what is left of it.
void readCloud(const fs::path& file, std::uint64_t seed) {
  readAll({.scans = file, .sensor_at_W = Eigen::Vector3d(0, 0, 1), .allow_truncated = seed % 4 == 0});
}
void readRays(const fs::path& file, std::uint64_t seed) { readAll({.scans = file, .allow_truncated = seed % 4 == 0}); }
/// Each corpus of these has `scans`, a folder or file, beside the file that is changed.
void readPoses(const fs::path& file, std::uint64_t seed) {
  readAll({.scans = file.parent_path() / "scans", .poses = file, .sort_poses = seed % 2 == 0});
}
void readTrajectory(const fs::path& file, std::uint64_t seed) {
  readAll({.scans = file.parent_path() / "scans.las", .sort_poses = seed % 2 == 0, .trajectory = file});
}
void readStations(const fs::path& file, std::uint64_t) {
  readAll({.scans = file.parent_path() / "scans", .stations = file});
}
void readRecording(const fs::path& file, std::uint64_t seed) {
  if (seed % 8 == 0) (void)io::summarizeRecording(file);
  readAll({.scans = file, .allow_truncated = seed % 4 == 0});
}
void readMesh(const fs::path& file, std::uint64_t) { (void)ToolGeometry::fromMesh(file, LengthUnit::Metre); }
void readState(const fs::path& file, std::uint64_t) {
  (void)AccessibilityField::loadState(file, ToolGeometry::builtin("builtin:pruner"), BackendKind::Cpu, 1);
}
/// plan.json, manifests and shards of a folder in tiles: the file is in it.
fs::path folderOfPlan(fs::path file) {
  while (file.has_parent_path() && file != file.parent_path()) {
    file = file.parent_path();
    if (fs::exists(file / "plan.json")) break;
  }
  return file;
}
void readTiles(const fs::path& file, std::uint64_t seed) {
  const fs::path out = folderOfPlan(file);
  const tiles::Plan plan = tiles::readPlan(out);
  if (const auto rays = tiles::binned(out, plan)) (void)tiles::status(out, plan, *rays);
  if (!tiles::hasIndex(out)) return;
  const tiles::Index index = tiles::readIndex(out);
  const std::array<Eigen::Vector3d, 1> places = {Eigen::Vector3d(2, 0.3, 0.1 * static_cast<double>(seed % 10))};
  (void)tiles::answersAt(index, places);
  (void)tiles::overview(index, 100);
}
void readField(const fs::path& file, std::uint64_t seed) {
  if (seed % 3 == 0) {
    (void)io::StoredField::open(file.parent_path()).at({2, 0.3, 1});
  } else if (file.extension() == ".vdb") {
    (void)io::summarizeVdb(file);
  } else if (file.extension() == ".ply") {
    (void)io::readPointsPly(file);
    (void)io::diffPoints({file}, {file});
  }
}
/// By the points themselves, and by answers at their places.
std::size_t openedInField(const fs::path& file, const fs::path& whole) {
  static const FieldSnapshot known = io::StoredField::open(whole).points();
  const io::StoredField damaged = io::StoredField::open(file.parent_path());
  const auto isOpen = [](const SurfacePoint& point) { return point.label == PointLabel::Accessible; };
  std::size_t opened = 0, asked = 0;
  const FieldSnapshot listed = io::readPointsPly(file.parent_path() / "points.ply");
  for (const SurfacePoint& point : known.points) {
    if (isOpen(point)) continue;
    if (point.id < listed.points.size() && isOpen(listed.points[point.id])) ++opened;
    if (asked++ >= 200) continue;
    const auto answer = damaged.at(point.position_W);
    if (answer.point && isOpen(*answer.point) && answer.point->position_W == point.position_W) ++opened;
  }
  return opened;
}
void readReport(const fs::path& file, std::uint64_t) {
  (void)io::writeHtmlReport(file.parent_path() / "report.html", file.parent_path());
}

const std::array kReaders = {
    Reader{"pcd", readCloud},
    Reader{"ply", readCloud},
    Reader{"las", readCloud},
    Reader{"xyz", readCloud},
    Reader{"bin", readCloud},
    Reader{"ptx", readRays},
    Reader{"rays", readRays},
    Reader{"poses", readPoses},
    Reader{"trajectory", readTrajectory},
    Reader{"stations", readStations},
    Reader{"recording", readRecording},
    Reader{"mesh", readMesh},
    Reader{"orientations", [](const fs::path& file, std::uint64_t) { (void)OrientationSet::read(file); }},
    Reader{"boxes", [](const fs::path& file, std::uint64_t) { (void)io::readBoxes(file); }},
    Reader{"segments", [](const fs::path& file, std::uint64_t) { (void)io::readLabelledCloud(file); }},
    Reader{"positions", [](const fs::path& file, std::uint64_t) { (void)io::readPositions(file); }},
    Reader{"tool_poses", [](const fs::path& file, std::uint64_t) { (void)io::readToolPoses(file); }},
    Reader{"state", readState},
    Reader{"tiles", readTiles},
    Reader{"field", readField, openedInField},
    Reader{"report", readReport},
    Reader{"toml", nullptr},  // the program alone reads those
};

}  // namespace

std::span<const Reader> readers() { return kReaders; }

}  // namespace accessvdb::campaign
