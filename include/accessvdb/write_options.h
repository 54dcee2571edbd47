// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How the files of a field are written: size, compression and up axis of the .vdb files, and what comes beside them.
#pragma once

#include <cstdint>

#include "accessvdb/export.h"
#include "accessvdb/survey_frame.h"

namespace accessvdb::io {

/// How the values of a .vdb file are compressed. OpenVDB's C++ library reads all of them if it was built with the
/// codec.
enum class Compression {
  Auto,   ///< Blosc if this build of OpenVDB has it, else Zip
  Blosc,  ///< fast
  Zip,    ///< smaller and many times slower
  None    ///< inactive values are still left out
};

/// Which axis of the .vdb files points up. The world frame is z up; with Y the grids' transforms and vectors are
/// rotated by -90 degrees about x, (x, y, z) to (x, z, -y). Voxel indices and non-vector values keep the same bits.
enum class UpAxis { Z, Y };

struct WriteOptions {
  bool half_float = false;  ///< 16-bit floats: all float grids except `score` and `weight`, which are counts
  /// With half_float: receives how many bytes field.vdb would have with 32-bit floats. Its float grids are then written
  /// twice, the second time to be counted.
  std::uint64_t* full_bytes = nullptr;
  Compression compression = Compression::Auto;
  UpAxis up_axis = UpAxis::Z;  ///< of field.vdb and field_points.vdb; points.ply is always in the world frame
  bool points_las = false;     ///< also write points.las, for programs of surveyors
  SurveyFrame frame = {};      ///< of points.las, whose coordinates are in its unit
  bool surface = false;        ///< also write `surface`, a narrow-band level set made from the points and their normals
};

/// Checks the options before anything is written. @throws InvalidArgument (a codec that this OpenVDB lacks)
ACCESSVDB_API void checkWriteOptions(const WriteOptions& options);

}  // namespace accessvdb::io
