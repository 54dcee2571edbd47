// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/live_options.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <tuple>

#include "accessvdb/error.h"
#include "runs/checkpoint.h"
#include "runs/memory_check.h"
#include "runs/rolling_live.h"

namespace accessvdb::tools {
namespace {

constexpr std::uint64_t kLeastMessage = std::uint64_t{64} << 10, kMostMessage = std::uint64_t{1} << 30;

/// Names of ROS: words of letters, digits and underscores with slashes between them.
void requireTopic(const char* flag, const std::string& topic) {
  const bool fits = topic.size() <= 200 && topic.size() > 1 && topic.front() == '/' && topic.back() != '/' &&
                    topic.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_/") ==
                        std::string::npos &&
                    topic.find("//") == std::string::npos;
  if (!fits)
    throw InvalidArgument("usage.topic", flag, "\"" + topic + "\" is not the full name of a topic",
                          "Use for example /livox/lidar; `ros2 topic list` shows them");
}

}  // namespace

void addLiveOptions(FlagParser& flags, LiveRunOptions& options) {
  MapOptions& map = options.map;
  map.forgetful = true;
  map.update_every = 1;
  flags.describe(
      "live",
      "Labels while the scanner runs: clouds, odometry and transforms of ROS 2 in, labelled points out, over DDS (" +
          dds::middleware() + "). Takes commands on " + dds::kCommandTopic +
          ", std_msgs/String with JSON such as {\"id\": 7, \"command\": \"save\"}: save, checkpoint, reset, remove, "
          "pause, "
          "resume.",
      "accessvdb live --cloud /livox/lidar --odom /Odometry --extrinsic=-0.011,-0.023,0.044 --tool builtin:pruner "
      "--voxel 0.05 --out out/\n"
      "  accessvdb live --cloud /cloud_registered --odom /Odometry --config live.toml --network --out out/");
  addCommonOptions(flags, map.common);
  flags.option("--cloud", &options.cloud, "topic with the clouds: sensor_msgs/PointCloud2 or Livox CustomMsg");
  flags.option("--odom", &options.odom, "topic with the poses: nav_msgs/Odometry or geometry_msgs/PoseStamped");
  flags.option("--imu", &options.imu, "topic of the IMU that --level imu reads: sensor_msgs/Imu");
  flags.option("--domain", &options.domain, "domain of DDS, 0 .. 232; default: ROS_DOMAIN_ID, else 0");
  flags.flag("--network", options.network, "use all network interfaces; without it nothing leaves this machine");
  flags.option("--queue", &options.queue, "if more scans wait, the oldest are fused without labels of their own");
  flags.option("--max-message", &options.max_message, "largest cloud that is accepted, for example 16M");
  flags.option("--max-memory", &map.max_memory,
               "limit on the memory of map and points, for example 2G; beyond it the map does not grow. Default: seven "
               "eighths of what the machine can give");
  flags.option("--points-every", &options.points_every_s, "seconds between messages with all points; 0 = never");
  flags.option("--status-every", &options.status_every_s, "seconds between messages about the run");
  flags.option("--checkpoint", &map.checkpoint, "folder in which the command checkpoint leaves the map's state");
  flags.option("--rolling", &map.rolling,
               "folder for tiles that the sensor has left: they go there past --max-memory, and come back with it, so "
               "that a flight of any length fits");
  flags.option("--checkpoint-every", &map.checkpoint_every,
               "with --rolling: time between checkpoints, for example 30s, 5m or 1h; 0 = only at the end");
  flags.option("--resume", &map.resume, "the folder of --rolling again: go on after its last checkpoint");
  flags.option("--scan-log", &options.scan_log, "write a line per scan into this file: taken, or why not");
  addFieldOptions(flags, map);
  addSensorOptions(flags, map.sensor);
  addMotionOptions(flags, map.sensor);
  addGapOption(flags, map.survey);
  flags.option("--out", &map.out, "folder for the files of map, written when the run is stopped");
  flags.option("--update-every", &map.update_every, "score after every n scans");
  flags.option("--budget-ms", &options.budget_ms,
               "milliseconds that a scan may take: so many points are scored as fit, the others between scans; 0 = no "
               "limit");
  flags.option("--policy", &map.policy, "how points to be scored again are chosen: exact or paper");
  flags.option("--corridor", &map.corridor_m, "length of the straight corridor that must be free, metres");
  flags.option("--origin", &map.origin,
               "X,Y,Z of the map's local origin in the world frame, or a folder with a result");
  flags.flag("--no-clobber", map.no_clobber, "refuse to overwrite existing outputs");
  addExportOptions(flags, map.exported);
  addPictureOptions(flags, map.picture);
  flags.flag("--print-config", map.print_config, "print the effective configuration as TOML and exit");
}

void checkLiveOptions(const LiveRunOptions& options) {
  checkCommonOptions(options.map.common);
  for (const auto& [flag, value, what] :
       {std::tuple{"--cloud", options.cloud, "the topic with the clouds, for example /livox/lidar"},
        std::tuple{"--odom", options.odom, "the topic with the poses, for example /Odometry"},
        std::tuple{"--tool", options.map.tool.tool, "a mesh, builtin:pencil or builtin:pruner"},
        std::tuple{"--out", options.map.out, "the folder for the results"}}) {
    if (value.empty()) throw InvalidArgument("usage.missing", flag, "is missing", std::string("Name ") + what);
  }
  requireTopic("--cloud", options.cloud);
  requireTopic("--odom", options.odom);
  if (options.cloud == options.odom)
    throw InvalidArgument("usage.topic", "--odom", "is the same topic as --cloud", "Name the topic with the poses");
  const bool by_imu = options.map.sensor.level == "imu";
  if (by_imu && options.imu.empty())
    throw InvalidArgument("usage.missing", "--imu", "is missing, which --level imu needs",
                          "Name the topic of the IMU, for example /livox/imu");
  if (!by_imu && !options.imu.empty())
    throw InvalidArgument("usage.imu", "--imu", "is only for --level imu", "Add --level imu, or omit it");
  if (by_imu) requireTopic("--imu", options.imu);
  if (options.map.update_every < 1)
    throw InvalidArgument("usage.update_every", "--update-every", "must be 1 or more", "Leave it out for 1");
  if (options.queue < 1 || options.queue > 1000)
    throw InvalidArgument("usage.queue", "--queue", "must be 1 .. 1000", "Leave it out for the default");
  for (const auto& [flag, value] :
       {std::pair{"--points-every", options.points_every_s}, std::pair{"--status-every", options.status_every_s}}) {
    if (!(value >= 0 && value <= 86400))
      throw InvalidArgument("usage.interval", flag, "must be 0 .. 86400 seconds", "Leave it out for the default");
  }
  if (options.budget_ms != 0) {
    if (!(options.budget_ms >= 1 && options.budget_ms <= 60000))
      throw InvalidArgument("usage.budget", "--budget-ms", "must be 1 .. 60000 milliseconds, or 0 for no limit",
                            "Use for example 80");
    if (!options.map.rolling.empty())
      throw InvalidArgument("usage.budget", "--budget-ms", "is not for --rolling, whose tiles share no budget",
                            "Leave out one of the two");
  }
  if (options.map.exported.sequence > 0)
    throw InvalidArgument("usage.sequence", "--sequence", "is for map, not for live", "Leave it out");
  requireRollingPossible(options);
  checkCheckpointOptions(options.map);
  (void)sessionOptions(options);
  (void)participantOptions(options);
  (void)renderOptions(options.map.picture);
  (void)writeOptions(options.map.exported);
  (void)fieldParams(options.map);
}

LiveOptions sessionOptions(const LiveRunOptions& options) {
  io::ScanInputOptions sensor;
  applySensorOptions(options.map.sensor, sensor);
  LiveOptions live;
  live.queue_scans = static_cast<std::size_t>(options.queue);
  live.max_gap_s = options.map.survey.max_gap_s;
  live.T_B_S = sensor.T_B_S;
  live.exclude_box_S = sensor.exclude_box_S;
  live.deskew = sensor.deskew;
  live.level = sensor.level;
  live.update_every = static_cast<std::size_t>(std::max(1, options.map.update_every));
  live.budget_ms = options.budget_ms;
  const std::uint64_t machine = memoryLimit(options.map).value_or(0);
  // What else the program needs, and others on the machine, must fit beside.
  live.memory_limit_bytes = options.map.max_memory.empty() ? machine / 8 * 7 : machine;
  return live;
}

dds::ParticipantOptions participantOptions(const LiveRunOptions& options) {
  const std::uint64_t most = parseBytes("--max-message", options.max_message);
  if (most < kLeastMessage || most > kMostMessage)
    throw InvalidArgument("usage.max_message", "--max-message", "must be 64k .. 1G", "Leave it out for the default");
  dds::ParticipantOptions participant;
  participant.domain = domainOf(options);
  participant.network = options.network;
  participant.most_message_bytes = static_cast<std::uint32_t>(most);
  participant.cloud_topic = options.cloud;
  participant.pose_topic = options.odom;
  participant.imu_topic = options.imu;
  return participant;
}

int domainOf(const LiveRunOptions& options) {
  constexpr int kMostDomain = 232;  // the ports of a higher one would be beyond 65535
  const char* environment = std::getenv("ROS_DOMAIN_ID");
  const bool given = !options.domain.empty();
  const std::string text = given ? options.domain : environment != nullptr ? environment : "";
  if (text.empty()) return 0;
  int domain = -1;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), domain);
  if (error != std::errc() || rest != text.data() + text.size() || domain < 0 || domain > kMostDomain)
    throw InvalidArgument("usage.domain", given ? "--domain" : "ROS_DOMAIN_ID",
                          "\"" + text.substr(0, 40) + "\" is not a domain", "Use 0 .. 232");
  return domain;
}

}  // namespace accessvdb::tools
