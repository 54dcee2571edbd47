// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of `live`: those of `map` that do not speak of files, and where scans and poses come from.
#pragma once

#include <cstdint>
#include <string>

#include "accessvdb/live_session.h"
#include "dds/participant.h"
#include "options/map_options.h"

namespace accessvdb::tools {

struct LiveRunOptions {
  MapOptions map;  ///< of which --scans, --poses and the like have no flag here
  std::string cloud, odom, imu, domain, max_message = "16M", scan_log;
  bool network = false;
  int queue = 4;
  double points_every_s = 1, status_every_s = 1, budget_ms = 0;
};

void addLiveOptions(FlagParser& flags, LiveRunOptions& options);
/// Checks what the flags alone determine. @throws InvalidArgument, DeviceError
void checkLiveOptions(const LiveRunOptions& options);

/// @throws InvalidArgument
[[nodiscard]] LiveOptions sessionOptions(const LiveRunOptions& options);
/// @throws InvalidArgument
[[nodiscard]] dds::ParticipantOptions participantOptions(const LiveRunOptions& options);
/// --domain, else ROS_DOMAIN_ID, else 0. @throws InvalidArgument "usage.domain"
[[nodiscard]] int domainOf(const LiveRunOptions& options);

}  // namespace accessvdb::tools
