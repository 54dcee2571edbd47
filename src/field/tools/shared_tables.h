// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tables of tools that several fields read: made once, by the field that comes first.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_spec.h"
#include "field/tools/scoring_setup.h"
#include "field/tools/window_margins.h"

namespace accessvdb::internal {

/// Of one list of tools with the same parameters; windows, origins and threads may differ. For any number of threads.
class SharedTables {
 public:
  SharedTables();
  ~SharedTables();
  SharedTables(const SharedTables&) = delete;
  SharedTables& operator=(const SharedTables&) = delete;

  /// Makes all tables now. @param tools  named  @return how far results depend on what is around
  /// @throws as the constructor of a field with these tools
  WindowMargins makeAll(const std::vector<ToolSpec>& tools, const FieldParams& params, const TableProgress& progress);
  /// @param number  of the tool in the list  @param backend  of the field: on a GPU there are other tables
  /// @throws as ScoringSetup does; the next call tries again
  [[nodiscard]] std::shared_ptr<const ScoringSetup> tablesOf(std::size_t number, const ToolGeometry& tool,
                                                             const FieldParams& resolved,
                                                             const kernels::Backend& backend,
                                                             const TableProgress& progress);
  /// Of all tables that were made.
  [[nodiscard]] std::uint64_t hostBytes() const;
  [[nodiscard]] std::uint64_t deviceBytes() const;
  /// Of the GPU that tables were made on; 0 if there is none.
  [[nodiscard]] std::uint64_t freeDeviceBytes() const;

 private:
  struct Made;
  template <typename Bytes>
  [[nodiscard]] std::uint64_t sum(bool on_host, const Bytes& bytes) const;

  mutable std::mutex lock_;
  std::array<std::vector<std::shared_ptr<const Made>>, 2> made_;  ///< by hasHostMemory(), then by number
};

}  // namespace accessvdb::internal
