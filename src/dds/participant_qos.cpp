// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/participant_qos.h"

#include <memory>

#include "dds/fastdds_compat.h"

namespace accessvdb::dds {
namespace {

rtps::Locator_t loopback() {
  rtps::Locator_t locator;
  locator.kind = LOCATOR_KIND_UDPv4;
  rtps::IPLocator::setIPv4(locator, 127, 0, 0, 1);
  return locator;
}

}  // namespace

fast::DomainParticipantQos participantQos(const char* name, bool network) {
  constexpr std::size_t kMostEndpoints = 512;
  constexpr std::uint32_t kSocketBytes = 4U << 20;  // the system may give less
  fast::DomainParticipantQos qos;
  qos.name(name);
  qos.allocation().participants = {0, kMostParticipants, 1};
  qos.allocation().readers = {0, kMostEndpoints, 1};
  qos.allocation().writers = {0, kMostEndpoints, 1};
  // Shared memory is left out: its versions differ between the releases of Fast DDS that ROS 2 comes with.
  qos.transport().use_builtin_transports = false;
  const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->receiveBufferSize = kSocketBytes;
  udp->sendBufferSize = kSocketBytes;
  if (!network) {
    // The loopback interface often has no multicast: the first participants of this machine are asked one by one.
    constexpr std::uint32_t kAskedParticipants = 32;
    udp->interfaceWhiteList.emplace_back("127.0.0.1");
    udp->maxInitialPeersRange = kAskedParticipants;
    rtps::BuiltinAttributes& discovery = qos.wire_protocol().builtin;
    discovery.initialPeersList.push_back(loopback());
    discovery.metatrafficUnicastLocatorList.push_back(loopback());
  }
  qos.transport().user_transports.push_back(udp);
  return qos;
}

}  // namespace accessvdb::dds
