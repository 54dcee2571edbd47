// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/checkpoint.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <ostream>
#include <set>
#include <sstream>
#include <utility>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/saved_state.h"
#include "output/json_text.h"
#include "output/progress.h"
#include "runs/progress_json.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kManifest = "state.json";
constexpr int kManifestSchema = 1;
constexpr std::uint64_t kMostManifestBytes = std::uint64_t{1} << 28;  // a million scans

std::vector<std::pair<std::string, std::string>> linesOf(const FieldParams& params) {
  std::vector<std::pair<std::string, std::string>> lines;
  std::istringstream text(params.describe());
  for (std::string line; std::getline(text, line);) {
    const auto space = line.find(' ');
    lines.emplace_back(line.substr(0, space), space == std::string::npos ? "" : line.substr(space + 1));
  }
  const auto origin = [&](std::size_t axis) { return params.origin_W ? (*params.origin_W)[axis] : 0.0; };
  lines.emplace_back("origin_W", params.origin_W
                                     ? fullNumber(origin(0)) + "," + fullNumber(origin(1)) + "," + fullNumber(origin(2))
                                     : "of the first scan");
  lines.emplace_back("mirror_distance", params.mirror_distance ? "true" : "false");
  return lines;
}

/// @return no object if that is not what the file holds, or there is none
Json parsed(const fs::path& manifest) {
  return Json::parse(io::contentAt(manifest, kMostManifestBytes), nullptr, false);
}

/// Also if it cannot be read. The first manifest only announces the first state, so that what is left of a run that is
/// killed between the two is known to be ours.
/// @param of  what the folder is to the caller
bool holdsCheckpoint(const fs::path& folder, ErrorCode of) {
  if (!io::isTaken(folder / kManifest, of)) return false;
  const Json json = parsed(folder / kManifest);
  return !json.is_object() || !json.contains("schema") || !json.contains("generation") || json["generation"] != 0;
}

}  // namespace

double parseDuration_s(const std::string& flag, const std::string& text) {
  double value = -1;
  const char* end = text.data() + text.size();
  const auto [rest, status] = std::from_chars(text.data(), end, value);
  const std::string unit(rest, end);
  double factor = unit == "ms" ? 1e-3 : unit == "s" ? 1 : unit == "m" ? 60 : unit == "h" ? 3600 : 0;
  if (unit.empty() && value == 0) factor = 1;
  if (status != std::errc() || !(value >= 0) || !std::isfinite(value) || factor == 0) {
    throw InvalidArgument("usage.duration", flag, "\"" + text + "\" is not a duration",
                          "Write a number with s, m or h, for example 30s or 5m, or 0");
  }
  return value * factor;
}

void checkCheckpointOptions(const MapOptions& options) {
  (void)parseDuration_s("--checkpoint-every", options.checkpoint_every);
  if (options.checkpoint.empty() && options.resume.empty()) return;
  if (fieldParams(options).update.policy == UpdatePolicy::Paper) {
    throw InvalidArgument("usage.checkpoint", options.checkpoint.empty() ? "--resume" : "--checkpoint",
                          "the paper's update policy depends on the field's history, which a checkpoint does not hold",
                          "Use --policy exact, or leave it out");
  }
}

void Checkpoints::prepare() {
  every_s_ = parseDuration_s("--checkpoint-every", options_.checkpoint_every);
  folder_ = options_.checkpoint.empty() ? options_.resume : options_.checkpoint;
  if (folder_.empty()) return;
  for (const std::string& folder : {options_.resume, options_.checkpoint}) {
    if (folder.empty() || !RollingField::hasCheckpoint(folder)) continue;
    throw UnusableInput("state.other", folder, "holds the tiles of a run with --rolling",
                        "Add --rolling " + folder + " to go on with it, or use another folder");
  }
  if (!options_.resume.empty()) {
    if (holdsCheckpoint(options_.resume, ErrorCode::Input)) {
      if (continuesInPlace()) io::prepareOutputFolder(folder_);  // another run may be writing its last one
      readManifest();
    } else if (options_.checkpoint.empty() || !continuesInPlace()) {
      throw InputError(
          "state.missing", options_.resume, "holds no checkpoint (" + std::string(kManifest) + ")",
          "Run without --resume; --checkpoint and --resume with the same folder start where there is none");
    }
  }
  refuseOthers();
  io::prepareOutputFolder(folder_);
  const Json json = parsed(folder_ / kManifest);
  if (!json.is_object()) return;
  const auto generation = [&](const char* key) -> std::uint64_t {
    return json.contains(key) && json[key].is_number_unsigned() ? json[key].get<std::uint64_t>() : 0;
  };
  generation_ = generation("generation");
  // What a killed run left: the one before, or the next one.
  for (const char* key : {"before", "next"}) {
    if (generation(key) != generation_) removeState(generation(key));
  }
}

/// A checkpoint that this run does not continue is somebody's work, and so is a manifest that we did not write.
void Checkpoints::refuseOthers() const {
  const fs::path manifest = folder_ / kManifest;
  if (!holdsCheckpoint(folder_, ErrorCode::Output) || (resumed_ && continuesInPlace())) return;
  if (options_.no_clobber) {
    throw OutputError("output.exists", manifest.string(), "exists, and --no-clobber was given",
                      "Use --resume to continue it, or choose another --checkpoint folder");
  }
  throw UnusableInput("state.other", folder_.string(),
                      "holds the checkpoint of another run, which this one would replace",
                      "Continue it with --resume, choose another --checkpoint folder, or delete it yourself");
}

fs::path Checkpoints::state(std::uint64_t generation) const {
  return folder_ / ("state-" + std::to_string(generation) + ".avst");
}

/// Whether new checkpoints replace the one of --resume.
bool Checkpoints::continuesInPlace() const {
  return options_.checkpoint.empty() ||
         fs::weakly_canonical(options_.resume) == fs::weakly_canonical(options_.checkpoint);
}

void Checkpoints::readManifest() {
  const fs::path file = fs::path(options_.resume) / kManifest;
  const auto damaged = [&](const std::string& what) {
    return InputError("state.damaged", file.string(), what, "Use another checkpoint, or start again without --resume");
  };
  const Json json = parsed(file);
  RunProgress progress;
  SavedState saved;
  try {
    if (!json.is_object() || json.at("schema") != kManifestSchema) {
      throw damaged("is not the manifest of a checkpoint that this program can read");
    }
    from_ = file.parent_path() / ("state-" + std::to_string(json.at("generation").get<std::uint64_t>()) + ".avst");
    progress = progressFrom(json);
    saved = inspectState(from_);
    if (saved.sha256 != json.at("head_sha256").get<std::string>() || saved.scans != progress.scansFused()) {
      throw damaged("belongs to another state than " + from_.filename().string());
    }
    reading_ = readingFrom(json);
  } catch (const Json::exception&) {
    throw damaged("has missing or malformed entries");
  }
  if (progress.next_step == 0 || progress.next_step > progress.steps || progress.scans.empty()) {
    throw damaged("has counts of steps and scans that contradict each other");
  }
  if (continuesInPlace()) written_scans_ = progress.scansFused();
  resumed_ = std::move(progress);
}

AccessibilityField Checkpoints::load(const std::vector<ToolSpec>& tools, const FieldParams& params) const {
  const auto before = linesOf(inspectState(from_).params), now = linesOf(params);
  for (std::size_t n = 0; n < std::min(before.size(), now.size()); ++n) {
    if (before[n] == now[n]) continue;
    refuseToResume("state.params", options_.resume,
                   before[n].first + " was " + before[n].second + " and is now " +
                       (before[n].first == now[n].first ? now[n].second : "replaced by " + now[n].first));
  }
  if (before.size() != now.size()) refuseToResume("state.params", options_.resume, "other parameters were given");
  return AccessibilityField::loadState(from_, tools, params, tableProgress(messages_));
}

bool Checkpoints::addsOtherScans(const std::vector<std::string>& paths) const {
  if (!resumed_ || paths.empty() || io::sha256OfFile(paths.front()) == resumed_->scans.front().sha256) return false;
  if (resumed_->next_step < resumed_->steps) {
    refuseToResume("state.scans", options_.resume,
                   "it stopped after " + std::to_string(resumed_->next_step) + " of " +
                       std::to_string(resumed_->steps) + " scans, the first of which is " +
                       resumed_->scans.front().path + ", and " + paths.front() + " is another one");
  }
  std::set<std::string> known;
  for (const auto* files : {&resumed_->earlier, &resumed_->scans}) {
    for (const io::InputFile& file : *files) known.insert(file.sha256);
  }
  const auto again = static_cast<std::size_t>(std::count_if(
      paths.begin(), paths.end(), [&](const std::string& path) { return known.contains(io::sha256OfFile(path)); }));
  const std::string share = std::to_string(again) + " of " + std::to_string(paths.size()) + " scans";
  if (2 * again > paths.size()) refuseToResume("state.scans", options_.resume, share + " are in it already");
  const auto before = reading_.find(kSystem);
  if (before != reading_.end() && !system_.empty() && before->second != system_ && options_.survey.crs.empty()) {
    throw UnusableInput("scans.frame", options_.resume, "holds scans in another coordinate system than these",
                        "Reproject these, or say with --crs which one all are in");
  }
  if (again > 0) messages_.warning("checkpoint.scans_again", share + " are in the checkpoint already");
  return true;
}

void Checkpoints::requireSameReading(std::uint64_t steps) const {
  tools::requireSameReading({*resumed_, reading_, options_.resume}, reading(), steps);
}

void Checkpoints::requireSameInputs(const RunProgress& now) const {
  tools::requireSameInputs({*resumed_, reading_, options_.resume}, now);
}

Reading Checkpoints::reading() const {
  Reading reading = readingOf(options_);
  for (const auto& [key, value] : read_as_) reading[key] = value;
  const auto before = reading_.find(kSystem);
  if (!system_.empty()) {
    reading[kSystem] = system_;
  } else if (before != reading_.end()) {
    reading[kSystem] = before->second;  // of earlier scans
  }
  return reading;
}

bool Checkpoints::due() const {
  if (folder_.empty() || every_s_ == 0) return false;
  return std::chrono::duration<double>(Clock::now() - last_).count() >= every_s_;
}

bool Checkpoints::write(const AccessibilityField& field, const RunProgress& progress) {
  if (folder_.empty() || progress.scansFused() == 0) return false;  // there is nothing to go on from
  if (written_scans_ == progress.scansFused()) return true;
  bool written = false;
  try {
    writeBoth(field, progress);
    written_scans_ = progress.scansFused();
    written = true;
  } catch (const OutputError& error) {
    warnOnce(std::string("no checkpoint was written: ") + error.what());
  } catch (const InputError& error) {
    warnOnce(std::string("the checkpoint cannot be read: ") + error.what());
  }
  std::error_code ignored;
  if (generation_ == 0) fs::remove(folder_ / kManifest, ignored);  // it announces a state that has failed
  last_ = Clock::now();
  return written;
}

/// Warnings are kept for the report, and a run may try for days.
void Checkpoints::warnOnce(const std::string& text) {
  if (!std::exchange(warned_, true)) messages_.warning("checkpoint.failed", text);
}

void Checkpoints::sayHowToGoOn() const {
  if (folder_.empty() || !written_scans_) return;
  messages_.notice("--resume " + folder_.string() + " goes on after scan " + std::to_string(*written_scans_));
}

void Checkpoints::writeBoth(const AccessibilityField& field, const RunProgress& progress) {
  const std::uint64_t generation = freeAfter(generation_);
  if (generation_ == 0)
    writeManifest(jsonText(Json{{"schema", kManifestSchema}, {"generation", 0}, {"next", generation}}, 1));
  try {
    saveAs(generation, field, progress);
  } catch (...) {
    forgetUnlessNamed(generation);
    throw;
  }
  if (generation_ > 0) removeState(generation_);
  generation_ = generation;
}

void Checkpoints::saveAs(std::uint64_t generation, const AccessibilityField& field, const RunProgress& progress) const {
  field.saveState(state(generation));
  Json json = {{"schema", kManifestSchema},     {"version", ACCESSVDB_VERSION},
               {"generation", generation},      {"before", generation_},
               {"next", freeAfter(generation)}, {"head_sha256", inspectState(state(generation)).sha256}};
  addProgress(progress, reading(), json);
  writeManifest(jsonText(json, 1));
}

void Checkpoints::writeManifest(const std::string& text) const {
  io::writeFileDurably(folder_ / kManifest, [&](std::ostream& out) { out << text << "\n"; });
}

/// After a failure: the manifest may be in place without being known to be on the disk, and then it names this state.
/// Otherwise no later run would find or delete it.
void Checkpoints::forgetUnlessNamed(std::uint64_t generation) noexcept {
  try {
    const Json json = parsed(folder_ / kManifest);
    if (json.is_object() && json.contains("generation") && json["generation"] == generation) {
      generation_ = generation;
    } else {
      std::error_code ignored;
      fs::remove(state(generation), ignored);
    }
  } catch (const std::exception&) {  // what cannot be read is left alone
  }
}

std::uint64_t Checkpoints::freeAfter(std::uint64_t generation) const {
  do {
    ++generation;
  } while (io::isTaken(state(generation), ErrorCode::Output));
  return generation;
}

/// Only one that a manifest names, and that is a whole state: others may have put a file of that name there since.
void Checkpoints::removeState(std::uint64_t generation) const {
  std::error_code error;
  if (generation == 0 || io::entryAt(state(generation)) != fs::file_type::regular) return;
  try {
    (void)inspectState(state(generation));
    fs::remove(state(generation), error);
  } catch (const Error&) {  // not ours
  }
}

}  // namespace accessvdb::tools
