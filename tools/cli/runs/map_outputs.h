// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The output folder of accessvdb map: what it may write there, and what it must not.
#pragma once

#include "options/map_options.h"
#include "output/output_files.h"

namespace accessvdb::tools {

/// Name of the page that `map --html` leaves beside report.json.
inline constexpr const char* kPageFile = "report.html";

class MapOutputs {
 public:
  /// @param options  must outlive it
  explicit MapOutputs(const MapOptions& options) : options_(options) {}

  /// Makes the folder, unless it holds what must stay.
  /// @throws OutputError "output.exists", "output.is_input"; UnusableInput "plan.changed"
  void claim();
  /// Checks all outputs once it is known which files are read.
  /// @throws OutputError "output.is_input", "output.foreign"
  void check(const Paths& inputs) const;
  /// Deletes what --fresh asks for, once scans, tool and memory have been checked, too. Of a map in
  /// tiles planOf() does so. @throws OutputError
  void startOver() const;
  /// Whether claim() refused: existing outputs must stay, the report among them.
  [[nodiscard]] bool refused() const { return refused_; }

 private:
  [[nodiscard]] Paths files() const;

  const MapOptions& options_;
  bool refused_ = false;
};

}  // namespace accessvdb::tools
