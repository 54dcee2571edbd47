// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/shared_tables.h"

#include "field/backend_choice.h"
#include "field/thread_count.h"
#include "field/tools/tools_of_field.h"

namespace accessvdb::internal {

/// The fields that read the tables come and go, and their backends with them.
struct SharedTables::Made {
  Made(const ToolGeometry& tool, const FieldParams& resolved, ChosenBackend chosen, const TableProgress& progress)
      : memory(std::move(chosen.backend)), setup(tool, resolved, *memory, progress) {}
  std::unique_ptr<kernels::Backend> memory;
  ScoringSetup setup;
};

SharedTables::SharedTables() = default;
SharedTables::~SharedTables() = default;

WindowMargins SharedTables::makeAll(const std::vector<ToolSpec>& tools, const FieldParams& params,
                                    const TableProgress& progress) {
  static_cast<void>(requireThreads(params.threads));
  const FieldParams resolved = resolvedFor(tools.front(), params);
  requireManyTools(tools, resolved);
  return onBackend(resolved, [&](const ChosenBackend& chosen) {
    WindowMargins margins;
    for (std::size_t n = 0; n < tools.size(); ++n) {
      const FieldParams of_tool = n == 0 ? resolved : resolvedFor(tools[n], resolved);
      const auto tables = tablesOf(n, tools[n].tool, of_tool, *chosen.backend, progress);
      margins = unionOf(margins, windowMargins(tables->tool(), of_tool));
    }
    return margins;
  });
}

std::shared_ptr<const ScoringSetup> SharedTables::tablesOf(std::size_t number, const ToolGeometry& tool,
                                                           const FieldParams& resolved, const kernels::Backend& backend,
                                                           const TableProgress& progress) {
  const std::scoped_lock locked(lock_);
  const bool on_host = backend.hasHostMemory();
  auto& made = made_[on_host ? 1 : 0];
  if (made.size() <= number) made.resize(number + 1);
  if (made[number] == nullptr) {
    made[number] = std::make_shared<const Made>(tool, resolved, on_host ? cpuBackend() : cudaBackend(), progress);
  }
  return {made[number], &made[number]->setup};
}

template <typename Bytes>
std::uint64_t SharedTables::sum(bool on_host, const Bytes& bytes) const {
  const std::scoped_lock locked(lock_);
  std::uint64_t all = 0;
  for (const auto& made : made_[on_host ? 1 : 0])
    if (made != nullptr) all += bytes(made->setup);
  return all;
}

std::uint64_t SharedTables::hostBytes() const {
  const auto host = [](const ScoringSetup& setup) { return setup.hostBytes(); };
  const auto device = [](const ScoringSetup& setup) { return setup.deviceBytes(); };
  return sum(false, host) + sum(true, host) + sum(true, device);  // the processor's backend has host memory
}

std::uint64_t SharedTables::deviceBytes() const {
  return sum(false, [](const ScoringSetup& setup) { return setup.deviceBytes(); });
}

std::uint64_t SharedTables::freeDeviceBytes() const {
  const std::scoped_lock locked(lock_);
  const auto& on_gpu = made_[0];
  return on_gpu.empty() || on_gpu.front() == nullptr ? 0 : on_gpu.front()->memory->freeBytes();
}

}  // namespace accessvdb::internal
