// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// make_sample_scans: simulated scans and poses for a first try, without any data of your own.
#include <charconv>
#include <cstdio>
#include <functional>
#include <map>
#include <string>

#include "accessvdb/error.h"
#include "sample_scans/scan_folder.h"

namespace {

constexpr const char* kUsage =
    "usage: make_sample_scans --out DIR [--frames 40] [--rays 20000] [--seed 1] [--range-noise 0] [--trees N]\n"
    "                         [--length METRES] [--max-range 30] [--flat] [--stamps]\n"
    "A walk past trees with a Mid-360-like scanner. Writes 000000.pcd ..., poses.txt (TUM), range_noise.txt.\n"
    "  --range-noise S  sigma of the range noise, metres      --trees N   default: one per 7 square metres\n"
    "  --length L       default: 0.1 m per frame               --flat      ground without bumps\n"
    "  --stamps         name the scans by time stamp\n";

template <typename Number>
void parse(const std::string& option, const std::string& text, Number& value) {
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) {
    throw accessvdb::InvalidArgument("sample.number", option, "is not a valid number: \"" + text + "\"",
                                     "See make_sample_scans --help");
  }
}

int run(int argc, char** argv) {
  accessvdb::samples::WalkOptions options;
  auto names = accessvdb::samples::ScanNames::FrameNumber;
  std::string out;
  using Setter = std::function<void(const std::string&, const std::string&)>;
  const std::map<std::string, Setter> with_value = {
      {"--out", [&](auto&, auto& text) { out = text; }},
      {"--frames", [&](auto& name, auto& text) { parse(name, text, options.frames); }},
      {"--rays", [&](auto& name, auto& text) { parse(name, text, options.rays_per_frame); }},
      {"--seed", [&](auto& name, auto& text) { parse(name, text, options.seed); }},
      {"--range-noise", [&](auto& name, auto& text) { parse(name, text, options.range_noise_m); }},
      {"--trees", [&](auto& name, auto& text) { parse(name, text, options.trees); }},
      {"--length", [&](auto& name, auto& text) { parse(name, text, options.length_m); }},
      {"--max-range", [&](auto& name, auto& text) { parse(name, text, options.max_range_m); }},
  };
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--help") {
      std::fputs(kUsage, stdout);
      return 0;
    }
    if (name == "--flat") {
      options.flat_ground = true;
    } else if (name == "--stamps") {
      names = accessvdb::samples::ScanNames::TimeStamp;
    } else if (const auto setter = with_value.find(name); setter == with_value.end()) {
      throw accessvdb::InvalidArgument("sample.option", name, "is not an option", "See make_sample_scans --help");
    } else if (++i == argc) {
      throw accessvdb::InvalidArgument("sample.value", name, "needs a value", "See make_sample_scans --help");
    } else {
      setter->second(name, argv[i]);
    }
  }
  if (out.empty()) {
    throw accessvdb::InvalidArgument("sample.out", "--out", "is missing", "Name the output folder");
  }
  const accessvdb::samples::WalkGenerator walk(options);
  accessvdb::samples::writeScanFolder(out, walk, names);
  std::printf("%s: %d scans of %d rays, seed %llu, range noise %g m\n", out.c_str(), options.frames,
              options.rays_per_frame, static_cast<unsigned long long>(options.seed), options.range_noise_m);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "make_sample_scans: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "make_sample_scans: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
