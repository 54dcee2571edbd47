// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/written_table.h"

#include <ostream>
#include <string>

#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/point_table.h"
#include "output/output_record.h"

namespace accessvdb::tools {

void writeTable(const std::filesystem::path& folder, Messages& messages) {
  io::OutputCheck check;
  const io::PointTable table = io::pointTable(folder, check);
  const std::filesystem::path file = folder / kTableFile;
  io::writeFileDurably(file, [&](std::ostream& stream) { stream << io::csvOf(table); });
  recordOutput(folder, file);
  messages.notice("wrote " + file.string() + " with " + std::to_string(table.rows.size()) + " rows");
}

}  // namespace accessvdb::tools
