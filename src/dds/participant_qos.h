// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How programs of this project join a domain.
#pragma once

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>

namespace accessvdb::dds {

/// The most participants that are remembered: further ones are not heard until others have gone. One that was killed
/// counts for ten seconds more.
inline constexpr int kMostParticipants = 256;

/// @param network  all interfaces with multicast, else UDP on 127.0.0.1 alone
[[nodiscard]] eprosima::fastdds::dds::DomainParticipantQos participantQos(const char* name, bool network);

}  // namespace accessvdb::dds
