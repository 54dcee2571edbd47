// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

namespace accessvdb::tools {
namespace {

constexpr auto kBarInterval = std::chrono::milliseconds(100);
constexpr auto kLineInterval = std::chrono::seconds(5);  // a log file needs signs of life, not an animation
constexpr std::chrono::steady_clock::duration kShort = std::chrono::seconds(1);
constexpr std::size_t kBarWidth = 30;

}  // namespace

std::string secondsInWords(double seconds) { return numberText(std::round(10 * seconds) / 10) + " s"; }

Progress::Progress(const Messages& messages, std::string label, std::size_t total, ShowShort show_short)
    : enabled_(!messages.quiet() && messages.format() == ErrorFormat::Text),
      terminal_(isatty(STDERR_FILENO) == 1),
      wait_(show_short == ShowShort::No),
      label_(std::move(label)),
      total_(total),
      start_(Clock::now()),
      last_(start_) {}

void Progress::show(std::size_t done, const std::string& detail) {
  const auto now = Clock::now();
  const bool last_step = done >= total_;
  if (!enabled_ || total_ == 0 ||
      (now - last_ < (terminal_ ? kBarInterval : Clock::duration(kLineInterval)) && !last_step))
    return;
  if (wait_ && now - start_ < (terminal_ ? kShort : Clock::duration(kLineInterval))) return;
  wait_ = false;
  last_ = now;
  const double seconds = std::chrono::duration<double>(now - start_).count();
  const double left_s =
      done > 0 ? seconds * static_cast<double>(total_ - std::min(done, total_)) / static_cast<double>(done) : 0;
  const std::string text = printable(detail);
  if (!terminal_) {
    std::fprintf(stderr, "accessvdb: %s %zu of %zu, %.0f s left%s%s\n", label_.c_str(), done, total_, left_s,
                 text.empty() ? "" : ", ", text.c_str());
    return;
  }
  const std::size_t filled = std::min(kBarWidth, kBarWidth * done / total_);
  std::fprintf(stderr, "\r%s [%s%s] %zu/%zu, %.0f s left %.60s\033[K", label_.c_str(), std::string(filled, '#').c_str(),
               std::string(kBarWidth - filled, ' ').c_str(), done, total_, left_s, text.c_str());
  std::fflush(stderr);
  open_line_ = true;
}

void Progress::finish() {
  if (open_line_) std::fputc('\n', stderr);
  open_line_ = false;
}

TableProgress tableProgress(const Messages& messages) {
  struct Bar {
    std::optional<Progress> progress;
    std::size_t last = 0;
  };
  return [&messages, bar = std::make_shared<Bar>()](std::size_t done, std::size_t total) {
    if (!bar->progress || done <= bar->last) {  // the next tool's
      bar->progress.emplace(messages, "making tables of the tool", total, ShowShort::No);
    }
    bar->last = done;
    bar->progress->show(done);
    if (done == total) bar->progress.reset();
  };
}

}  // namespace accessvdb::tools
