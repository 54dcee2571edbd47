// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frame loop: what becomes of a scan, and of an update. The only place where the stages meet.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <span>

#include "field/field_stages.h"

namespace accessvdb::internal {

/// Returns the scan that passed the gate, and counts what was dropped.
using GateScan = std::function<const GatedScan&(FrameStats& stats)>;

/// Takes a scan into map, points and mirrors. @param stamp_s  not finite: the scan has none
FrameStats integrateScan(FieldStages& field, const GateScan& gate,
                         double stamp_s = std::numeric_limits<double>::quiet_NaN());

/// integrateScan() of a tile, in two parts: between them the tiles tell each other what has gone (FieldAccess).
/// @param ray_p_L, ray_q_L  all rays that come near the tile
void beginScan(FieldStages& field, const GateScan& gate, std::span<const Eigen::Vector3f> ray_p_L,
               std::span<const Eigen::Vector3f> ray_q_L, double stamp_s);
FrameStats endScan(FieldStages& field, std::span<const OpenedLeaf> opened);

/// Brings the field's time to where that of a larger map is, of which it is a tile: free space ages as if it had got
/// every scan of that map, most of them without a return here.
/// @param latest_s  stamp of the latest scan there  @param age_s  FreeGenerations::age_s() there; not less than here
void advanceTime(FieldStages& field, std::optional<double> latest_s, double age_s);

/// Points that are unscored whatever their state says are so from now on: at each update.
void publishWithheld(FieldStages& field);

/// Call when the host's map has all scans and LeadingMap::diverged(), inside the arena, while no update runs. All that
/// the device has is made again from the host: its map, and what it found out about the points; then it leads again. If
/// there were labels, they are brought up to date, whatever the budget.
/// @throws DeviceError "device.diverged"  it happened too often, or voxels were left out of the map
void makeDeviceAgain(FieldStages& field);

/// Brings the labels up to date, at once or on a thread of its own.
UpdateStats updateLabels(FieldStages& field);
UpdateTicket updateLabelsAsync(FieldStages& field);

}  // namespace accessvdb::internal
