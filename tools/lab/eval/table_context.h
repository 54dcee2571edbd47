// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// State shared by the functions that make tables.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/approaches.h"
#include "eval/scene_run.h"
#include "eval/table_options.h"
#include "eval/table_row.h"

namespace accessvdb::eval {

struct TableContext {
  const TableOptions& options;
  ScanStore& scans;
  SceneRunner& runner;
  std::vector<TableRow>& rows;  ///< rows are added as they are made, so that a stop keeps them
  std::string& device;          ///< as in TableResults; for fields that are not the runner's
};

/// A table row for a run, judged with the method's own normals; the caller fills in the rest.
inline TableRow rowOf(const char* table, const RunRequest& request, const EvaluatedRun& run, TableColumn column,
                      std::string variant = {}) {
  TableRow row;
  row.table = table;
  row.scene = request.scans.scene;
  row.method = column == TableColumn::Paper ? "paper" : "product";
  row.variant = std::move(variant);
  row.column = column;
  row.voxel_m = request.params.tsdf.voxel_size_m;
  row.figures = run.shared();
  return row;
}

/// About `count` of the viewpoints, evenly spread over the run (50; box and wall 25).
std::vector<Eigen::Vector3d> someViewpoints(const std::vector<Eigen::Vector3d>& viewpoints_W, std::size_t count);

/// table_pictures.cpp: draws truth, product profile, HPR and errors of every scene in the product's rows.
void drawScenes(TableContext& context);

// tables_of_profiles.cpp: both profiles unchanged.
void makeOracleTable(TableContext& context);
void makeVoxelTable(TableContext& context);
void makeUnseenTable(TableContext& context);
void makeFramesTable(TableContext& context);
void makeNoiseTable(TableContext& context);
void makeUnfilteredTable(TableContext& context);
void makeFastTable(TableContext& context);

// tables_of_variants.cpp: a profile with something changed.
void makeClampingTable(TableContext& context);
void makeRingTable(TableContext& context);
void makeDirectionsTable(TableContext& context);
void makeFormTable(TableContext& context);
void makeIncrementalTable(TableContext& context);

// tables_of_baselines.cpp: other methods.
void makeHprTable(TableContext& context);
void makeProjectiveTable(TableContext& context);

// table_of_pseudo_truth.cpp: judging without a scene, calibrated where there is one.
void makePseudoTruthTable(TableContext& context);

// table_of_change.cpp: things that come and go.
void makeChangeTable(TableContext& context);
// table_of_cuts.cpp: part of it; what a cut would open, against scanning without what is cut.
void makeCutRows(TableContext& context);
// films_of_change.cpp: part of it; what the map says before, while and after things go.
void drawFilms(TableContext& context);
void makeGoneTable(TableContext& context);
// table_of_motion.cpp: a sensor that moves while it scans.
void makeMotionTable(TableContext& context);

// table_of_orientations.cpp: tools that tilt or roll.
void makeOrientationsTable(TableContext& context);
void makeMarginsTable(TableContext& context);
void makeApproachesTable(TableContext& context);
/// What approaches() proposes with these options, judged by the exact scene.
void addApproachRow(TableContext& context, const AccessibilityField& field,
                    const std::shared_ptr<const sim::SignedDistance>& distance, const std::string& scene,
                    const ApproachOptions& options, double least_contact_percent);

// table_of_fits.cpp: whether a tool fits at any pose.
void makeFitsTable(TableContext& context);
// table_of_plans.cpp: ways to approaches, planned with OMPL. @throws InvalidArgument "evaluate.ompl" without it
void makePlansTable(TableContext& context);
// table_of_views.cpp: where to look next.
void makeViewsTable(TableContext& context);

// table_of_probability.cpp: SurfacePoint::access_probability against what is accessible, decile by decile.
void makeProbabilityTable(TableContext& context);
void makeProbabilityPineTable(TableContext& context);
void makeProbabilityFit(TableContext& context);

// table_of_pine.cpp: takes minutes to hours, so not part of "all".
void makePineTable(TableContext& context);
void makePineFormTable(TableContext& context);

}  // namespace accessvdb::eval
