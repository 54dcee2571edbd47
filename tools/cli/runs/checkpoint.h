// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Checkpoints of a run of `map`: the folder of --checkpoint and --resume.
///
/// It holds state-N.avst (AccessibilityField::saveState) and state.json, which names it and is written last. An older
/// state is removed only then, so whenever a run is killed there is one whole checkpoint, or none yet.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/scan_io.h"
#include "options/map_options.h"
#include "output/report.h"
#include "runs/run_progress.h"

namespace accessvdb::tools {

/// "30s", "5m", "1h", "250ms", fractions too, or "0". @throws InvalidArgument naming the flag
[[nodiscard]] double parseDuration_s(const std::string& flag, const std::string& text);

class Checkpoints {
 public:
  /// @param options  must outlive this, as must messages
  Checkpoints(const MapOptions& options, Messages& messages) : options_(options), messages_(messages) {}

  /// Makes the folder, removes what killed runs left in it, and reads the checkpoint of --resume.
  /// @throws InputError "state.missing", "state.damaged"; UnusableInput "state.rules", "state.other"; OutputError
  void prepare();

  /// Says how the scans turned out to be read, beside what the options say.
  void readAs(const std::string& key, const std::string& value) { read_as_[key] = value; }
  /// Says in which coordinate system the scans are.
  void readIn(const SurveyFrame& frame) { system_ = frame.systemSha256(); }
  /// Where --resume goes on; nothing for a run from the beginning.
  [[nodiscard]] const std::optional<RunProgress>& resumed() const { return resumed_; }
  /// The field of resumed(). @throws UnusableInput "state.params", naming the first difference, "state.tool"
  [[nodiscard]] AccessibilityField load(const std::vector<ToolSpec>& tools, const FieldParams& params) const;
  /// Whether these are other scans than those of resumed(), to be added after them.
  /// @param paths  files of the scans, in order
  /// @throws UnusableInput "state.scans" if resumed() did not get to the end of its own, or most are in it already;
  /// "scans.frame" if they are in another coordinate system
  [[nodiscard]] bool addsOtherScans(const std::vector<std::string>& paths) const;
  /// Compares how the scans of resumed() were listed with how they are now.
  /// @throws UnusableInput "state.params", "state.scans"
  void requireSameReading(std::uint64_t steps) const;
  /// Compares the files. @param now  with as many scans read
  /// @throws UnusableInput "state.scans", naming the first difference
  void requireSameInputs(const RunProgress& now) const;

  /// Whether --checkpoint-every has passed since the last one.
  [[nodiscard]] bool due() const;
  /// Writes one, unless there is nothing new. If that fails, a warning says so the first time, and the run goes on.
  /// @return whether the last one is of that field
  bool write(const AccessibilityField& field, const RunProgress& progress);
  /// The field changed by more than scans: the next one is written in any case.
  void noteChange() { written_scans_.reset(); }
  /// For a run that was stopped.
  void sayHowToGoOn() const;

 private:
  using Clock = std::chrono::steady_clock;

  void readManifest();
  [[nodiscard]] bool continuesInPlace() const;
  void writeBoth(const AccessibilityField& field, const RunProgress& progress);
  void saveAs(std::uint64_t generation, const AccessibilityField& field, const RunProgress& progress) const;
  void writeManifest(const std::string& text) const;
  void warnOnce(const std::string& text);
  void forgetUnlessNamed(std::uint64_t generation) noexcept;
  void refuseOthers() const;
  [[nodiscard]] std::uint64_t freeAfter(std::uint64_t generation) const;
  void removeState(std::uint64_t generation) const;
  [[nodiscard]] std::filesystem::path state(std::uint64_t generation) const;

  const MapOptions& options_;
  Messages& messages_;
  std::filesystem::path folder_;  ///< empty without --checkpoint and --resume
  std::filesystem::path from_;    ///< state of resumed()
  double every_s_ = 0;
  std::uint64_t generation_ = 0;                ///< of the last one in the folder
  std::optional<std::uint64_t> written_scans_;  ///< in the last one, if it is of the field as it is
  bool warned_ = false;
  std::optional<RunProgress> resumed_;
  [[nodiscard]] Reading reading() const;

  Reading read_as_;
  std::string system_;  ///< SurveyFrame::systemSha256()
  Reading reading_;     ///< of resumed()
  Clock::time_point last_ = Clock::now();
};

/// @throws InvalidArgument "usage.duration"; "usage.checkpoint" where the policy has no checkpoints
void checkCheckpointOptions(const MapOptions& options);

}  // namespace accessvdb::tools
