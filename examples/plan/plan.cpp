// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// plan MAP TOOL X Y Z OUT.csv: plans a way from a place to each of the ten best approaches, through space that was
/// seen to be free, and on to contact.
///   MAP      folder of accessvdb map --checkpoint (with --clear-rays and --platform-radius), or a state file
///   TOOL     the tool that it was made with: builtin:NAME, or a mesh in metres with its tip at its origin
///   X Y Z    where the tool's tip is now, world frame, metres: a pose of the sensor, for example
///   OUT.csv  the tool's poses on each way: target, x y z, qw qx qy qz, whether it is in contact
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/approaches.h"
#include "accessvdb/error.h"
#include "accessvdb/ompl.h"
#include "accessvdb/orientations.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_spec.h"

namespace {

namespace fs = std::filesystem;
using accessvdb::AccessibilityField;
using Space = std::shared_ptr<ompl::base::SE3StateSpace>;

constexpr double kMostSeconds = 5;

/// The one that state.json names; a run that was killed may have left others.
fs::path stateIn(const fs::path& map) {
  if (!fs::is_directory(map)) return map;
  std::ifstream in(map / "state.json");
  const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  const std::string key = "\"generation\":";
  const std::size_t at = text.find(key);
  const unsigned long number = at == std::string::npos ? 0 : std::strtoul(text.c_str() + at + key.size(), nullptr, 10);
  if (number > 0) return map / ("state-" + std::to_string(number) + ".avst");
  throw accessvdb::InputError("example.map", map.string(), "holds no state",
                              "Run accessvdb map with --checkpoint, and name that folder");
}

double numberOf(const char* text) {
  char* end = nullptr;
  const double number = std::strtod(text, &end);
  if (end == text || *end != '\0' || !(std::abs(number) < 1e7))
    throw accessvdb::InvalidArgument("example.number", text, "is not a number of metres", "Write for example 1.5");
  return number;
}

AccessibilityField load(const fs::path& map, const std::string& tool_name) {
  const accessvdb::ToolGeometry tool =
      tool_name.starts_with("builtin:")
          ? accessvdb::ToolGeometry::builtin(tool_name)
          : accessvdb::ToolGeometry::fromMesh(tool_name, accessvdb::LengthUnit::Metre, {});
  const fs::path state = stateIn(map);
  const accessvdb::FieldParams params = accessvdb::inspectState(state).params;
  AccessibilityField field = AccessibilityField::loadState(state, accessvdb::onlyTool(tool, params));
  field.update();  // does nothing where the labels came with the state
  return field;
}

/// The box that holds all surface points and the start.
Space spaceOf(const AccessibilityField& field, const Eigen::Vector3d& start_W) {
  constexpr double kAround_m = 1;
  Eigen::AlignedBox3d box(start_W);
  const auto points = field.points();
  for (std::size_t n = 0; n < points->size(); ++n) box.extend(points->at(n).position_W);
  ompl::base::RealVectorBounds bounds(3);
  for (unsigned axis = 0; axis < 3; ++axis) {
    bounds.setLow(axis, box.min()[axis] - kAround_m);
    bounds.setHigh(axis, box.max()[axis] + kAround_m);
  }
  auto space = std::make_shared<ompl::base::SE3StateSpace>();
  space->setBounds(bounds);
  return space;
}

/// The tool at the start, turned so that it fits there.
Eigen::Isometry3d startPose(const AccessibilityField& field, const Eigen::Vector3d& start_W) {
  constexpr int kTurns = 36;
  std::vector<Eigen::Isometry3d> poses;
  for (int n = 0; n < kTurns; ++n) {
    Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
    T_WT.translation() = start_W;
    T_WT.linear() = Eigen::AngleAxisd(2 * M_PI * n / kTurns, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    poses.push_back(T_WT);
  }
  bool collides = true;
  const std::vector<accessvdb::FitAnswer> answers = field.poseQuery().fits(poses);
  for (std::size_t n = 0; n < answers.size(); ++n) {
    if (answers[n].free()) return poses[n];
    collides = collides && answers[n].collision();
  }
  throw accessvdb::UnusableInput(
      "example.start", "X Y Z",
      collides ? "is where the tool collides, however it is turned" : "is where nobody knows whether the tool fits",
      collides ? "Start where there is room"
               : "Map with --clear-rays and --platform-radius, and start at a pose of the sensor");
}

/// Poses to contact; empty if none were found in time.
std::vector<Eigen::Isometry3d> wayTo(const accessvdb::ApproachPath& approach, const Eigen::Isometry3d& start_T_WT,
                                     const AccessibilityField& field, const Space& space) {
  ompl::geometric::SimpleSetup setup(space);
  accessvdb::planIn(field, *setup.getSpaceInformation(), {.contact_T_WT = {approach.contact_T_WT}});
  // Steps as long as the tool: known free space is as wide as that, not as the room.
  const auto planner = std::make_shared<ompl::geometric::RRTConnect>(setup.getSpaceInformation());
  planner->setRange(field.tool().reach_m());
  setup.setPlanner(planner);
  setup.setStartAndGoalStates(accessvdb::stateOf(start_T_WT, space),
                              accessvdb::stateOf(approach.pre_contact_T_WT, space));
  if (setup.solve(kMostSeconds) != ompl::base::PlannerStatus::EXACT_SOLUTION) return {};
  setup.simplifySolution(1.0);
  std::vector<Eigen::Isometry3d> way;
  for (const ompl::base::State* state : setup.getSolutionPath().getStates())
    way.push_back(accessvdb::poseOf(*state->as<ompl::base::SE3StateSpace::StateType>()));
  const bool reaches =
      setup.getSpaceInformation()->checkMotion(accessvdb::stateOf(approach.pre_contact_T_WT, space).get(),
                                               accessvdb::stateOf(approach.contact_T_WT, space).get());
  if (!reaches) return {};
  way.push_back(approach.contact_T_WT);
  return way;
}

double lengthOf_m(const std::vector<Eigen::Isometry3d>& way) {
  double length_m = 0;
  for (std::size_t n = 1; n < way.size(); ++n) length_m += (way[n].translation() - way[n - 1].translation()).norm();
  return length_m;
}

void write(std::ostream& out, std::size_t target, const std::vector<Eigen::Isometry3d>& way) {
  for (std::size_t n = 0; n < way.size(); ++n) {
    const Eigen::Quaterniond q(way[n].linear());
    const Eigen::Vector3d& p = way[n].translation();
    out << target << ',' << p.x() << ',' << p.y() << ',' << p.z() << ',' << q.w() << ',' << q.x() << ',' << q.y() << ','
        << q.z() << ',' << (n + 1 == way.size() ? 1 : 0) << '\n';
  }
}

int run(char** arguments) {
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  ompl::RNG::setSeed(1);  // the same plans each time, as far as the time allows
  const Eigen::Vector3d start_W(numberOf(arguments[3]), numberOf(arguments[4]), numberOf(arguments[5]));
  const fs::path file = arguments[6];
  if (fs::exists(file))
    throw accessvdb::OutputError("example.exists", file.string(), "exists already", "Name a new file");
  if (file.has_parent_path() && !fs::is_directory(file.parent_path()))
    throw accessvdb::OutputError("example.folder", file.parent_path().string(), "is no folder", "Make it first");
  const AccessibilityField field = load(arguments[1], arguments[2]);
  const Space space = spaceOf(field, start_W);
  const Eigen::Isometry3d start_T_WT = startPose(field, start_W);
  const accessvdb::Approaches found = accessvdb::approaches(field, {.most = 10, .from_W = start_W});
  std::ostringstream out;
  out.precision(9);
  out << "target,x,y,z,qw,qx,qy,qz,contact\n";
  std::size_t planned = 0;
  for (std::size_t n = 0; n < found.targets.size(); ++n) {
    const accessvdb::ApproachTarget& target = found.targets[n];
    const auto begin = std::chrono::steady_clock::now();
    std::vector<Eigen::Isometry3d> way;
    for (const accessvdb::ApproachPath& approach : target.approaches) {
      way = wayTo(approach, start_T_WT, field, space);
      if (!way.empty()) break;
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    if (way.empty()) {
      std::printf("%zu  point %u: no way found in %.0f s per approach\n", n, target.point, kMostSeconds);
      continue;
    }
    ++planned;
    write(out, n, way);
    std::printf("%zu  point %u: %.2f m, %zu poses, %.2f s\n", n, target.point, lengthOf_m(way), way.size(),
                seconds.count());
  }
  std::ofstream written(file, std::ios::binary);
  if (!(written << out.str()).flush()) {
    written.close();
    fs::remove(file);
    throw accessvdb::OutputError("example.write", file.string(), "cannot be written", "Free some space");
  }
  std::printf("%zu of %zu targets -> %s\n", planned, found.targets.size(), arguments[6]);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 7) {
    std::fprintf(stderr, "usage: plan MAP TOOL X Y Z OUT.csv\n");
    return 2;
  }
  try {
    return run(argv);
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "plan: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "plan: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
