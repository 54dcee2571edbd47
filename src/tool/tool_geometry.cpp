// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/tool_geometry.h"

#include <openssl/evp.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "accessvdb/error.h"
#include "tool/builtin_tools.h"
#include "tool/mesh_openings.h"
#include "tool/mesh_reader.h"
#include "tool/mesh_repair.h"

namespace accessvdb {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr double kMinSize_m = 0.001, kMaxSize_m = 20.0;
/// Share of the tool's size beyond which a tip off the mesh is more likely a mistake than a choice.
constexpr double kTipGapShare = 0.1;
/// The same where nobody chose the tip: the mesh's origin is the tip only by chance.
constexpr double kDefaultTipGapShare = 0.02;
/// Share of the tool's size: a centroid that is less far behind the tip does not tell which way the axis runs.
constexpr double kCentroidShare = 0.02;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value + 0.0);  // no "-0"
  return text;
}

std::string triple(const Eigen::Vector3d& p, const char* between) {
  return number(p.x()) + between + number(p.y()) + between + number(p.z());
}

/// A file's name may hold anything, and the tool's name goes into headers of files, line by line.
std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    char code[8];
    std::snprintf(code, sizeof code, "\\x%02x", byte);
    text += byte < 0x20 || byte == 0x7f ? std::string(code) : std::string(1, c);
  }
  return text;
}

/// Counts are written little endian and coordinates as their bits, so that the digest is platform-independent.
std::string digestOf(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& triangles,
                     double margin_m) {
  static_assert(sizeof(Eigen::Vector3f) == 12 && sizeof(Triangle) == 12);
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  const std::uint64_t counts[2] = {vertices.size(), triangles.size()};
  const bool done = context && EVP_DigestInit_ex(context, EVP_sha256(), nullptr) == 1 &&
                    EVP_DigestUpdate(context, counts, sizeof counts) == 1 &&
                    EVP_DigestUpdate(context, vertices.data(), 12 * vertices.size()) == 1 &&
                    EVP_DigestUpdate(context, triangles.data(), 12 * triangles.size()) == 1 &&
                    (margin_m == 0 || EVP_DigestUpdate(context, &margin_m, sizeof margin_m) == 1) &&
                    EVP_DigestFinal_ex(context, digest, &size) == 1;
  EVP_MD_CTX_free(context);
  if (!done) throw InternalError("tool.digest", "", "the SHA-256 of the tool could not be computed");
  std::string text;
  for (unsigned int n = 0; n < size; ++n) {
    char byte[3];
    std::snprintf(byte, sizeof byte, "%02x", digest[n]);
    text += byte;
  }
  return text;
}

/// Distance from the origin to the nearest point of a triangle.
double distanceToOrigin(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const Eigen::Vector3d* corner[3] = {&a, &b, &c};
  bool inside = normal.squaredNorm() > 0;
  double nearest = std::numeric_limits<double>::infinity();
  for (int e = 0; e < 3; ++e) {
    const Eigen::Vector3d &from = *corner[e], edge = *corner[(e + 1) % 3] - from;
    if (normal.dot(edge.cross(-from)) < 0) inside = false;
    const double length2 = edge.squaredNorm();
    const double t = length2 > 0 ? std::clamp(-from.dot(edge) / length2, 0.0, 1.0) : 0.0;
    nearest = std::min(nearest, (from + t * edge).norm());
  }
  return inside ? std::abs(a.dot(normal)) / normal.norm() : nearest;
}

/// Rows: the tool frame's axes in the mesh's axes.
Eigen::Matrix3d rotationOf(const ToolPose& pose, const std::string& subject, std::vector<std::string>& notes) {
  for (const Eigen::Vector3d& p : {pose.axis, pose.up, pose.tip.value_or(Eigen::Vector3d::Zero())}) {
    if (!p.allFinite()) {
      throw InvalidArgument("tool.pose", subject, "the tool's tip, axis or up is not finite",
                            "Set ToolPose::tip, ToolPose::axis and ToolPose::up to three numbers each");
    }
  }
  const double axis_length = pose.axis.stableNorm(), up_length = pose.up.stableNorm();
  if (!(axis_length > 0) || !(up_length > 0)) {
    throw InvalidArgument("tool.pose", subject, "the tool's axis or up is zero",
                          "Use directions such as ToolPose::axis 1,0,0 ToolPose::up 0,0,1");
  }
  const Eigen::Vector3d x = pose.axis / axis_length, up = pose.up / up_length;
  Eigen::Vector3d z = up - up.dot(x) * x;
  if (!(z.norm() > 1e-6)) {
    // A tool that stands on end in its own frame: +x, or what is least along the axis.
    Eigen::Index least = 0;
    x.cwiseAbs().minCoeff(&least);
    const Eigen::Vector3d other = Eigen::Vector3d::Unit(least);
    z = other - other.dot(x) * x;
    notes.push_back("the axis (" + triple(pose.axis, ",") + ") is along up (" + triple(pose.up, ",") + "): (" +
                    triple(other, ",") + ") of the mesh is up instead; ToolPose::up chooses another");
  }
  Eigen::Matrix3d rows;
  rows.row(0) = x;
  rows.row(2) = z.normalized();
  rows.row(1) = rows.row(2).cross(rows.row(0));
  return rows;
}

/// @param size_m  largest extent
std::string openNote(const internal::RepairedMesh& mesh, double size_m) {
  const internal::MeshOpenings openings = internal::findOpenings(mesh.vertices, mesh.triangles);
  if (!openings.any()) return "the faces cannot all face outwards: all that they enclose counts as tool";
  const std::string edges = "the mesh is open (" + std::to_string(mesh.open_edges) + " open edges, ";
  if (openings.width_m > internal::kWidestOpening * size_m) {
    return edges +
           (std::isfinite(openings.width_m) ? number(openings.width_m) + " m wide" : "a sheet with no other side") +
           "), too far to close it: only its surface counts as tool, and what that encloses";
  }
  return edges + number(openings.width_m) + " m wide): the openings are closed, and what is shut in counts as tool";
}

std::vector<std::string> notesOf(const internal::RepairedMesh& mesh, double size_m) {
  std::vector<std::string> notes;
  if (mesh.zero_area > 0) notes.push_back(std::to_string(mesh.zero_area) + " triangles without area removed");
  if (mesh.zero_area_kept > 0) {
    notes.push_back(std::to_string(mesh.zero_area_kept) + " triangles without area kept: they close the surface");
  }
  if (mesh.duplicates > 0) notes.push_back(std::to_string(mesh.duplicates) + " duplicate triangles removed");
  if (mesh.flipped > 0)
    notes.push_back(std::to_string(mesh.flipped) + " triangles flipped to agree with their neighbours");
  if (mesh.welded_by_tolerance)
    notes.push_back("vertices closer than a millionth of the mesh's size joined to close it");
  if (!mesh.watertight) notes.push_back(openNote(mesh, size_m));
  return notes;
}

/// Where the tip is, seen from the mesh.
struct TipPlace {
  double gap_m = 0;              ///< from the nearest part of the surface
  double centroid_x_m = 0;       ///< of the surface; negative: the body is on the far side of the tip
  double size_m = 0;             ///< largest extent
  Eigen::Vector3d likely_tip_T;  ///< centre of the end of the tool that the body extends from
  [[nodiscard]] bool isWrongWay() const { return centroid_x_m < -kCentroidShare * size_m; }
  /// Off the surface by more than a share of the size, and not between the fingers of a gripper either.
  [[nodiscard]] bool isOff(double share) const {
    return gap_m > share * size_m && likely_tip_T.norm() > kDefaultTipGapShare * size_m;
  }
};

/// Centre of the end of a tool: of the box around the vertices that are within a hundredth of its length from the end.
/// @param axis  0, 1, 2: x, y, z  @param side  -1: the end with the lowest coordinate, 1: that with the highest
Eigen::Vector3d endOf(const ToolGeometry& tool, Eigen::Index axis, int side) {
  const double end = side < 0 ? tool.min_T()[axis] : tool.max_T()[axis];
  const double slack_m = 0.01 * (tool.max_T()[axis] - tool.min_T()[axis]);
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Eigen::Vector3f& vertex : tool.vertices_T()) {
    const Eigen::Vector3d p = vertex.cast<double>();
    if (std::abs(p[axis] - end) > slack_m) continue;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  Eigen::Vector3d centre = (low + high) / 2;
  centre[axis] = end;
  return centre;
}

TipPlace placeOfTip(const ToolGeometry& tool) {
  TipPlace place;
  double area = 0, moment = 0;
  place.gap_m = std::numeric_limits<double>::infinity();
  for (const Triangle& t : tool.triangles()) {
    const Eigen::Vector3d a = tool.vertices_T()[t[0]].cast<double>(), b = tool.vertices_T()[t[1]].cast<double>(),
                          c = tool.vertices_T()[t[2]].cast<double>();
    const double twice_area = (b - a).cross(c - a).norm(), x = (a + b + c).x() / 3;
    area += twice_area;
    moment += twice_area * x;
    place.gap_m = std::min(place.gap_m, distanceToOrigin(a, b, c));
  }
  place.centroid_x_m = moment / area;
  place.size_m = (tool.max_T() - tool.min_T()).cast<double>().maxCoeff();
  place.likely_tip_T = endOf(tool, 0, place.isWrongWay() ? 1 : -1);
  return place;
}

/// How warnings about a tip name the likely one: in the mesh's own units and frame, where that is known.
struct TipWords {
  bool tip_given = true;
  std::array<std::string, 2> ends;  ///< flags for either end of the longest extent; empty: not known
};

/// What looks like a wrong tip or axis, in words.
std::vector<std::string> tipWarnings(const TipPlace& place, const TipWords& words) {
  const std::string likely =
      "; the tip is probably at one end of the longest extent, and the other may be the mount: " + words.ends[0] +
      ", or " + words.ends[1];
  if (place.isWrongWay()) {
    return {"warning: the tool's centroid is " + number(-place.centroid_x_m) +
            " m on the far side of the tip, in the direction in which the tool approaches" +
            (words.ends[0].empty() ? "; check the axis (from the tip along the body) and the tip" : likely)};
  }
  if (place.isOff(words.tip_given ? kTipGapShare : kDefaultTipGapShare)) {
    return {
        "warning: " +
        std::string(words.tip_given ? "the tip" : "the mesh's origin, which is the tip unless ToolPose::tip is set,") +
        " is " + number(place.gap_m) + " m away from the nearest part of the mesh" +
        (words.ends[0].empty() ? "; check the tip and the unit" : likely + "; or check LengthUnit")};
  }
  return {};
}

/// @throws InvalidArgument "tool.index", UnusableInput "tool.nonfinite"
void requireMesh(const std::vector<Eigen::Vector3f>& vertices_T, const std::vector<Triangle>& triangles,
                 const std::string& name) {
  for (const Triangle& t : triangles) {
    for (std::uint32_t v : t) {
      if (!(v < vertices_T.size())) {
        throw InvalidArgument(
            "tool.index", name,
            "a triangle refers to vertex " + std::to_string(v) + " of " + std::to_string(vertices_T.size()));
      }
      if (!vertices_T[v].allFinite()) {
        throw UnusableInput("tool.nonfinite", name, "vertex " + std::to_string(v) + " is not finite",
                            "Export the mesh again");
      }
    }
  }
}

void requireFaces(const std::vector<Triangle>& triangles, const std::string& name, const char* problem) {
  if (triangles.empty()) {
    throw UnusableInput("tool.no_faces", name, problem, "Export the tool as a surface of triangles or polygons");
  }
}

}  // namespace

double metresPer(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::Metre:
      return 1.0;
    case LengthUnit::Centimetre:
      return 0.01;
    case LengthUnit::Millimetre:
      return 0.001;
    case LengthUnit::Inch:
      return 0.0254;
  }
  throw InvalidArgument("tool.unit", "", "the length unit is not one of metre, centimetre, millimetre and inch");
}

ToolGeometry::ToolGeometry(std::vector<Eigen::Vector3f> vertices_T, std::vector<Triangle> triangles,
                           const std::string& name, bool watertight)
    : vertices_T_(std::move(vertices_T)),
      triangles_(std::move(triangles)),
      name_(escaped(name)),
      sha256_(digestOf(vertices_T_, triangles_, 0)),
      watertight_(watertight),
      min_T_(vertices_T_[0]),
      max_T_(vertices_T_[0]) {
  double reach_m = 0;
  for (const Eigen::Vector3f& p : vertices_T_) {
    min_T_ = min_T_.cwiseMin(p);
    max_T_ = max_T_.cwiseMax(p);
    reach_m = std::max(reach_m, p.cast<double>().norm());
  }
  reach_m_ = float(reach_m);
}

ToolGeometry ToolGeometry::fromTriangles(std::vector<Eigen::Vector3f> vertices_T, std::vector<Triangle> triangles,
                                         std::string name) {
  requireMesh(vertices_T, triangles, name);
  internal::RepairedMesh mesh = internal::repairMesh(vertices_T, triangles);
  requireFaces(mesh.triangles, name, triangles.empty() ? "the mesh has no faces" : "no face has an area");
  ToolGeometry tool(mesh.vertices, mesh.triangles, name, mesh.watertight);
  tool.notes_ = notesOf(mesh, (tool.max_T_ - tool.min_T_).cast<double>().maxCoeff());
  for (std::string& note : tipWarnings(placeOfTip(tool), {})) tool.notes_.push_back(std::move(note));
  return tool;
}

ToolGeometry ToolGeometry::restored(std::vector<Eigen::Vector3f> vertices_T, std::vector<Triangle> triangles,
                                    const std::string& name, std::vector<std::string> notes, bool watertight,
                                    double margin_m) {
  requireMesh(vertices_T, triangles, name);
  requireFaces(triangles, name, "the mesh has no faces");
  ToolGeometry tool(std::move(vertices_T), std::move(triangles), name, watertight);
  tool.notes_ = std::move(notes);
  return tool.grownBy(margin_m);
}

ToolGeometry ToolGeometry::fromMesh(const std::filesystem::path& path, std::optional<LengthUnit> unit,
                                    const ToolPose& pose) {
  const std::string subject = path.string();
  std::vector<std::string> pose_notes;
  const Eigen::Matrix3d R_T_M = rotationOf(pose, subject, pose_notes);
  const internal::FileMesh mesh = internal::readMeshFile(path);

  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : mesh.vertices) box.extend(p.cast<double>());
  std::vector<std::string> notes = mesh.notes;
  notes.insert(notes.end(), pose_notes.begin(), pose_notes.end());
  // The vertices' unit may differ from the file's; the tip is in the file's.
  const double file_units_per_vertex_unit =
      mesh.metres_per_file_unit > 0 ? mesh.metres_per_vertex_unit / mesh.metres_per_file_unit : 1.0;
  const Eigen::Vector3d extents = file_units_per_vertex_unit * box.sizes();
  double metres_per_file_unit = mesh.metres_per_file_unit;
  if (unit) {
    if (metres_per_file_unit > 0 && std::abs(metresPer(*unit) / metres_per_file_unit - 1) > 1e-6) {
      notes.push_back("warning: the file gives its unit as " + number(metres_per_file_unit) + " m; " +
                      number(metresPer(*unit)) + " m is used instead, as requested");
    }
    metres_per_file_unit = metresPer(*unit);
  }
  if (!(metres_per_file_unit > 0)) {
    throw InvalidArgument(
        "tool.unit", subject,
        "this mesh format has no length unit; its extents are " + triple(extents, " x ") + " in the file's units",
        "Specify it: LengthUnit m, cm, mm or in");
  }
  const double size_m = extents.maxCoeff() * metres_per_file_unit;
  if (!(size_m >= kMinSize_m && size_m <= kMaxSize_m)) {
    throw UnusableInput("tool.size", subject,
                        "the tool would be " + number(size_m) + " m large (" + triple(extents, " x ") +
                            " in the file's units); 0.001 to 20 m is plausible",
                        "Check LengthUnit: m, cm, mm or in");
  }

  const Eigen::Vector3d tip_M = pose.tip.value_or(Eigen::Vector3d::Zero());
  std::vector<Eigen::Vector3f> vertices_T;
  vertices_T.reserve(mesh.vertices.size());
  for (const Eigen::Vector3f& p_M : mesh.vertices) {
    const Eigen::Vector3d from_tip_M = file_units_per_vertex_unit * p_M.cast<double>() - tip_M;
    vertices_T.emplace_back((metres_per_file_unit * (R_T_M * from_tip_M)).cast<float>());
  }
  ToolGeometry tool = fromTriangles(std::move(vertices_T), mesh.triangles, path.filename().string());
  notes.push_back("size " + triple((tool.max_T_ - tool.min_T_).cast<double>(), " x ") + " m, from (" +
                  triple(tool.min_T_.cast<double>(), ", ") + ") to (" + triple(tool.max_T_.cast<double>(), ", ") +
                  ") in the tool frame; tip (" + triple(tip_M, ", ") + "), axis (" + triple(R_T_M.row(0), ", ") +
                  "), up (" + triple(R_T_M.row(2), ", ") + ") in the mesh's frame");
  // The warnings about the tip again, now that the mesh's own units and axes are known.
  std::erase_if(tool.notes_, [](const std::string& note) { return note.starts_with("warning: "); });
  tool.notes_.insert(tool.notes_.begin(), notes.begin(), notes.end());
  const TipPlace place = placeOfTip(tool);
  TipWords words = {pose.tip.has_value(), {}};
  Eigen::Index longest = 0;
  (tool.max_T_ - tool.min_T_).maxCoeff(&longest);
  for (const int side : {-1, 1}) {
    Eigen::Vector3d end_M = R_T_M.transpose() * endOf(tool, longest, side) / metres_per_file_unit + tip_M;
    Eigen::Vector3d axis_M = R_T_M.transpose() * (-side * Eigen::Vector3d::Unit(longest));
    for (double& x : end_M) {
      if (std::abs(x) * metres_per_file_unit < 1e-6 * place.size_m) x = 0;  // what the rotation's rounding left
    }
    for (double& x : axis_M) {
      if (std::abs(x) < 1e-6) x = 0;
    }
    words.ends[side < 0 ? 0 : 1] = "ToolPose::tip=" + triple(end_M, ",") + " ToolPose::axis=" + triple(axis_M, ",");
  }
  for (std::string& warning : tipWarnings(place, words)) tool.notes_.push_back(std::move(warning));
  return tool;
}

ToolGeometry ToolGeometry::grownBy(double margin_m) const {
  const double size_m = (max_T_ - min_T_).cast<double>().maxCoeff();
  if (!(margin_m >= 0 && margin_m <= size_m)) {
    throw InvalidArgument("tool.margin", number(margin_m) + " m",
                          "is not a margin of " + name_ + ", which is " + number(size_m) + " m large",
                          "Use a voxel or more, up to " + number(size_m) + " m");
  }
  ToolGeometry grown = *this;
  grown.margin_m_ = margin_m;
  grown.sha256_ = digestOf(vertices_T_, triangles_, margin_m);
  return grown;
}

ToolGeometry ToolGeometry::builtin(const std::string& name) {
  internal::BuiltinMesh mesh = internal::builtinMesh(name);
  return fromTriangles(std::move(mesh.vertices_T), std::move(mesh.triangles), name);
}

}  // namespace accessvdb
