// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/checked_results.h"

namespace accessvdb::tools {

void addAllowChanged(FlagParser& flags, bool& allow_changed) {
  flags.flag("--allow-changed", allow_changed,
             "read results that are not as they were written, with a warning: you changed them on purpose");
}

void sayFindings(const io::OutputCheck& check, Messages& messages) {
  for (const auto& [id, text] : check.warnings()) messages.warning(id, text);
  for (const std::string& text : check.notices()) messages.notice(text);
}

}  // namespace accessvdb::tools
