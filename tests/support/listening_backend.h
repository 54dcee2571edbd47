// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A backend that decides which points are due, as a GPU does, with the test's updater and the CPU's memory.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "launch/backend.h"

namespace accessvdb::test {

class ListeningBackend final : public kernels::Backend {
 public:
  using MakeUpdater = std::function<std::unique_ptr<kernels::PointUpdater>(const kernels::UpdaterTables&)>;

  explicit ListeningBackend(MakeUpdater make_updater)
      : cpu_(kernels::makeCpuBackend()), make_updater_(std::move(make_updater)) {}
  std::string name() const override { return "listening"; }
  std::unique_ptr<kernels::MirrorArena> makeArena() override { return cpu_->makeArena(); }
  void writePoints(const kernels::PointStateView&, const kernels::PointInput*, std::size_t) override {}
  void scorePoints(const kernels::ScoreRequest&) override {}
  std::unique_ptr<kernels::PointUpdater> makeUpdater(const kernels::UpdaterTables& tables) override {
    return make_updater_(tables);
  }
  void* allocate(std::size_t bytes) override { return cpu_->allocate(bytes); }
  void release(void* address) noexcept override { cpu_->release(address); }
  void upload(void* to, const void* from, std::size_t bytes) override { cpu_->upload(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { cpu_->download(to, from, bytes); }
  void copy(void* to, const void* from, std::size_t bytes) override { cpu_->copy(to, from, bytes); }

 private:
  std::unique_ptr<kernels::Backend> cpu_;
  MakeUpdater make_updater_;
};

}  // namespace accessvdb::test
