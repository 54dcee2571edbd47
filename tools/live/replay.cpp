// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// live_replay: a recording as topics of ROS 2, to try `accessvdb live` with, without a scanner and without ROS.
#include "dds/replay.h"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "accessvdb/error.h"

namespace {

volatile std::sig_atomic_t stop_signal = 0;
void stop(int signal) { stop_signal = signal; }

constexpr const char* kUsage =
    "usage: live_replay RECORDING [--domain N] [--rate R] [--network]\n"
    "Publishes the clouds, poses, transforms and IMUs of a recording of ROS 2 (.mcap, .db3, or a folder of parts) "
    "once\n"
    "somebody listens. --rate: times as fast as it was recorded; 0 = as fast as it is heard. --domain: 0 unless "
    "given.\n";

/// The number behind a flag, if it is in a range.
bool readNumber(const char* text, double low, double high, double& value) {
  char* end = nullptr;
  value = text == nullptr ? -1 : std::strtod(text, &end);
  return text != nullptr && end != text && *end == '\0' && value >= low && value <= high;
}

}  // namespace

int main(int argc, char** argv) {
  accessvdb::dds::ReplayOptions options;
  double domain = 0;
  for (int n = 1; n < argc; ++n) {
    bool known = true;
    if (std::strcmp(argv[n], "--domain") == 0) {
      known = readNumber(argv[++n], 0, 232, domain) && domain == static_cast<int>(domain);
    } else if (std::strcmp(argv[n], "--rate") == 0) {
      known = readNumber(argv[++n], 0, 1000, options.rate);
    } else if (std::strcmp(argv[n], "--network") == 0) {
      options.network = true;
    } else if (argv[n][0] != '-' && options.recording.empty()) {
      options.recording = argv[n];
    } else {
      known = false;
    }
    if (!known) {
      std::fputs(kUsage, stderr);
      return 2;
    }
  }
  if (options.recording.empty()) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  options.domain = static_cast<int>(domain);
  options.stopped = [] { return stop_signal != 0; };
  std::signal(SIGINT, stop);
  std::signal(SIGTERM, stop);
  try {
    std::printf("published %llu messages\n", static_cast<unsigned long long>(accessvdb::dds::replay(options)));
    return stop_signal == 0 ? 0 : 128 + static_cast<int>(stop_signal);
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "live_replay: error[%s] %s. %s.\n", error.id().c_str(), error.what(), error.advice().c_str());
    return static_cast<int>(error.code());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "live_replay: %s\n", error.what());
    return 70;
  }
}
