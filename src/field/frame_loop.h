// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frame loop: what becomes of a scan, and of an update. The only place where the stages meet.
#pragma once

#include <functional>
#include <limits>

#include "field/field_stages.h"

namespace accessvdb::internal {

/// Returns the scan that passed the gate, and counts what was dropped.
using GateScan = std::function<const GatedScan&(FrameStats& stats)>;

/// Takes a scan into map, points and mirrors. @param stamp_s  not finite: the scan has none
FrameStats integrateScan(FieldStages& field, const GateScan& gate,
                         double stamp_s = std::numeric_limits<double>::quiet_NaN());

/// Brings the labels up to date, at once or on a thread of its own.
UpdateStats updateLabels(FieldStages& field);
UpdateTicket updateLabelsAsync(FieldStages& field);

}  // namespace accessvdb::internal
