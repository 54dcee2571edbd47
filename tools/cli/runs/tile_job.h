// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// From the flags of `map` to a plan of tiles, and from a plan in a folder back to what is needed to carry it out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/tiles.h"
#include "options/map_options.h"

namespace accessvdb::tools {

/// Flags of `map` that a plan keeps, as "name", "value"; paths are made absolute.
using PlanSettings = std::vector<std::pair<std::string, std::string>>;
[[nodiscard]] PlanSettings planSettings(const FlagParser& flags);

/// Everything open that a plan is made from.
struct PlanSources {
  const MapOptions& options;
  const PlanSettings& settings;
  const std::vector<ToolSpec>& tools;  ///< named
  io::ScanSequence& scans;
  FieldParams params;
};

/// Why these options cannot be mapped in tiles, or nothing.
[[nodiscard]] std::optional<std::string> whyNotInTiles(const MapOptions& options, const FieldParams& params);

/// What a plan of these sources says of their options and scans: Plan::parameters beside those of the field, and the
/// flight.
[[nodiscard]] std::pair<std::string, tiles::Flight> plannedSources(const PlanSources& sources);

/// The same of a live run, of which no scan is in a file. @param given  planSettings()  @param params  resolved
[[nodiscard]] std::pair<std::string, tiles::Flight> plannedLive(const PlanSettings& given, const FieldParams& params);

/// Deletes the files that a run in one piece left in the folder, where they are ours: they are of another run than the
/// tiles. Later ones may be merged from these.
void removePieces(const std::filesystem::path& out);

/// The plan of these sources, written into the folder, or the one that is there if it is the same: sizes of that one
/// are kept where none are given.
/// @param chosen_voxels  edge of a tile that the prediction of memory chose; 0 takes --tiles
/// @throws InvalidArgument "usage.tiles"; UnusableInput "plan.changed"; OutputError "output.foreign"; what reading the
///         scans throws
[[nodiscard]] tiles::Plan planOf(const PlanSources& sources, std::int32_t chosen_voxels, Messages& messages);

/// Opens what the plan in the folder names. Only flags that say how to run are taken from `options`: device, threads,
/// memory. @throws InputError "plan.missing", "plan.damaged"; UnusableInput "plan.changed"
struct OpenJob {
  MapOptions options;               ///< of the first flight
  std::vector<MapOptions> flights;  ///< of each, to open its scans
  std::vector<ToolSpec> tools;
  tiles::Job job;
};
[[nodiscard]] OpenJob openJob(const std::filesystem::path& out, const MapOptions& options);

/// The scans of a flight, by what its settings say, with the poses that the plan gives them.
[[nodiscard]] io::ScanInputOptions inputOfFlight(const OpenJob& open, std::size_t flight);
/// @throws UnusableInput "plan.changed" for poses, or another small file, that are not those of the plan; InputError
void requirePlannedPoses(const OpenJob& open, std::size_t flight);
/// Options of a flight of the plan by other settings.
[[nodiscard]] MapOptions flightOptions(const OpenJob& open, const PlanSettings& settings);
/// What a plan says of the scans.
[[nodiscard]] tiles::Flight flightOf(const PlanSources& sources, const PlanSettings& settings);

/// Adds the scans that `options` names to the plan in the folder.
/// @throws UnusableInput "plan.changed"; what reading the scans throws
void appendFlight(const std::filesystem::path& out, const MapOptions& options, const FlagParser& flags,
                  Messages& messages);

/// The scans of all flights.
class OpenScans {
 public:
  /// @throws UnusableInput "plan.changed" if they are not those of the plan
  OpenScans(const OpenJob& job, Messages& messages);
  [[nodiscard]] std::span<io::ScanSequence* const> flights() const { return pointers_; }

 private:
  std::vector<io::ScanSequence> scans_;
  std::vector<io::ScanSequence*> pointers_;
};

}  // namespace accessvdb::tools
