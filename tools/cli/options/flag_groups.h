// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The headings of --help for verbs with many flags. A flag is about the same in every verb that has it.
#pragma once

#include <array>
#include <string_view>

namespace accessvdb::tools {

/// In the order of --help. The last one takes what no other has.
inline constexpr std::array<std::string_view, 6> kFlagGroups = {"Input", "Tool", "World", "Output", "Expert", "Run"};

struct FlagsOfGroup {
  std::string_view group, names;  ///< with blanks around each name
};
inline constexpr std::array<FlagsOfGroup, 5> kFlagsOfGroups = {{
    {"Input",
     " --scans --poses --sensor-at --pose-format --calib --every --allow-truncated --allow-disagreement "
     "--allow-changed "
     "--sort-poses --trajectory "
     "--time-offset --max-gap --match "
     "--stations --ray --keep-noise --laz-command --topic --pose-topic --fixed-frame --extrinsic --exclude-box "
     "--deskew --level "
     "--cloud "
     "--odom --imu --domain --network --queue --max-message --min-range --max-range --range-noise --segments "
     "--append --replay-log --pseudo-truth --halves --densities "},
    {"Tool",
     " --tool --tool-name --tool-unit --tool-tip --tool-axis --tool-up --orientations --rolls --max-collisions "
     "--corridor "
     "--allow-open-tool --allow-hidden-tool --for-tool "},
    {"World", " --voxel --origin --change --static --free-for --clear-rays --platform-radius --remove --removed-as "},
    {"Output",
     " --out --no-clobber --half --compression --up-axis --surface --points-format --sequence --view --colour --width "
     "--height --html --json --scan-log --points-every --status-every --per-frame "},
    {"Expert",
     " --tau --profile --policy --directions --knn --points --point-spacing --update-every --budget-ms --budget-points "
     "--bin-memory --keep-rays "
     "--mirror-distance --host-fusion "},
}};

}  // namespace accessvdb::tools
