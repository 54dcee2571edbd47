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
  using MakeExact = std::function<std::unique_ptr<kernels::ExactUpdater>(const kernels::ExactTables&)>;
  using MakePaper = std::function<std::unique_ptr<kernels::PaperUpdater>(const kernels::PaperTables&)>;

  /// @param make_exact, make_paper  only the one that the test needs
  explicit ListeningBackend(MakeExact make_exact, MakePaper make_paper = {})
      : cpu_(kernels::makeCpuBackend()), make_exact_(std::move(make_exact)), make_paper_(std::move(make_paper)) {}
  std::string name() const override { return "listening"; }
  std::unique_ptr<kernels::MirrorArena> makeArena() override { return cpu_->makeArena(); }
  void writePoints(const kernels::PointStateView&, const kernels::PointInput*, std::size_t) override {}
  void writeSeen(const kernels::PointStateView&, const std::uint32_t*, const std::uint64_t*, std::size_t) override {}
  void readPoints(const kernels::PointStateView& points, const std::uint32_t* ids, kernels::StateRow* rows,
                  std::size_t count) override {
    cpu_->readPoints(points, ids, rows, count);
  }
  void takeAllTold(const kernels::PointStateView& points, const kernels::ToldStates& states) override {
    cpu_->takeAllTold(points, states);
  }
  void scorePoints(const kernels::ScoreRequest&) override {}
  void fitTool(const kernels::FitRequest&) override {}
  std::unique_ptr<kernels::ExactUpdater> makeExactUpdater(const kernels::ExactTables& tables) override {
    return make_exact_(tables);
  }
  std::unique_ptr<kernels::PaperUpdater> makePaperUpdater(const kernels::PaperTables& tables) override {
    return make_paper_(tables);
  }
  void* allocate(std::size_t bytes) override { return cpu_->allocate(bytes); }
  void release(void* address, std::size_t bytes) noexcept override { cpu_->release(address, bytes); }
  void upload(void* to, const void* from, std::size_t bytes) override { cpu_->upload(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { cpu_->download(to, from, bytes); }
  void copy(void* to, const void* from, std::size_t bytes) override { cpu_->copy(to, from, bytes); }

 private:
  std::unique_ptr<kernels::Backend> cpu_;
  MakeExact make_exact_;
  MakePaper make_paper_;
};

}  // namespace accessvdb::test
