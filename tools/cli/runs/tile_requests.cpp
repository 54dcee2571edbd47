// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/tile_requests.h"

#include <unistd.h>

#include <csignal>
#include <thread>
#include <utility>

#include "accessvdb/error.h"
#include "output/stop_signal.h"

namespace accessvdb::tools {
namespace {

constexpr std::chrono::milliseconds kLook{100};  ///< a signal does not wake who waits for a line
constexpr std::size_t kLongestLine = 4096;

}  // namespace

TileRequests::TileRequests() : lines_(std::make_shared<Lines>()) {
  std::thread([lines = lines_] { read(*lines); }).detach();
}

void TileRequests::read(Lines& lines) {
  std::string line;
  char byte = 0;
  while (::read(STDIN_FILENO, &byte, 1) > 0 && line.size() < kLongestLine) {
    if (byte != '\n') {
      line += byte;
      continue;
    }
    const std::lock_guard lock(lines.mutex);
    lines.waiting.push_back(std::exchange(line, {}));
    lines.changed.notify_all();
  }
  const std::lock_guard lock(lines.mutex);
  lines.ended = true;
  lines.cut_off = !line.empty();
  lines.changed.notify_all();
  if (lines.busy && stopSignal() == 0) ::kill(::getpid(), SIGTERM);
}

std::optional<std::string> TileRequests::next(std::chrono::milliseconds idle) {
  std::unique_lock lock(lines_->mutex);
  lines_->busy = false;
  const auto until = std::chrono::steady_clock::now() + idle;
  while (lines_->waiting.empty() && !lines_->cut_off) {
    if (lines_->ended || stopSignal() != 0 || std::chrono::steady_clock::now() >= until) return std::nullopt;
    lines_->changed.wait_for(lock, kLook);
  }
  if (stopSignal() != 0) return std::nullopt;
  if (lines_->ended) {  // nobody waits for a tile any more
    throw InvalidArgument("usage.worker", "standard input", "ended before the tiles that it names were mapped",
                          "Keep it open until each name has been printed, or use --tile");
  }
  std::string line = std::move(lines_->waiting.front());
  lines_->waiting.pop_front();
  lines_->busy = true;
  return line;
}

}  // namespace accessvdb::tools
