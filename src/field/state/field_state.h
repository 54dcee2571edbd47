// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field's state as a whole: what is saved of it, and how a new field takes it over.
#pragma once

#include <filesystem>

#include "field/field_stages.h"
#include "field/state/state_reader.h"
#include "io/streams/whole_file.h"

namespace accessvdb::internal {

/// @param write  makes the file  @throws OutputError, InvalidArgument "usage.checkpoint"
void saveState(const FieldStages& field, const std::filesystem::path& file, io::WriteFile write);
/// Only for a new field. @throws InputError "state.damaged"; then the field is of no use any more
void restoreState(FieldStages& field, StateReader& state);

}  // namespace accessvdb::internal
