// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "gis/geopackage.h"

#include "gis/memory_file.h"
#include "gis/spatial_reference.h"

namespace accessvdb::gis {

struct GeoPackage::Impl {
  MemoryFile file{".gpkg"};
  DataSet data{nullptr};
  OGRLayerH layer = nullptr;

  Impl() : data(gdal().GDALCreate(gdal().GDALGetDriverByName("GPKG"), file.name(), 0, 0, 0, GDT_Unknown, nullptr)) {
    if (data.get() == nullptr) failOf("make a GeoPackage");
  }
};

GeoPackage::GeoPackage(const std::string& layer, const std::string& description,
                       const std::vector<LayerColumn>& columns, const SurveyFrame& frame) {
  gdal().CPLErrorReset();
  impl_ = std::make_unique<Impl>();
  const SpatialReference reference = referenceOf(frame);
  std::string described = "DESCRIPTION=" + description;
  char no_system[] = "SRS_ID=-1";  // Cartesian; without it, degrees
  char* options[] = {described.data(), reference ? nullptr : no_system, nullptr};
  impl_->layer = gdal().GDALDatasetCreateLayer(impl_->data.get(), layer.c_str(), reference.get(), wkbPoint25D, options);
  if (impl_->layer == nullptr) failOf("make a layer");
  for (const LayerColumn& column : columns) {
    const OGRFieldType type = column.type == LayerColumn::Type::Whole  ? OFTInteger
                              : column.type == LayerColumn::Type::Real ? OFTReal
                                                                       : OFTString;
    const OGRFieldDefnH field = gdal().OGR_Fld_Create(column.name.c_str(), type);
    const OGRErr made = gdal().OGR_L_CreateField(impl_->layer, field, FALSE);
    gdal().OGR_Fld_Destroy(field);
    if (made != OGRERR_NONE) failOf("make the column " + column.name);
  }
  // One transaction: each feature by itself would be a hundred times slower.
  if (gdal().GDALDatasetStartTransaction(impl_->data.get(), FALSE) != OGRERR_NONE) failOf("begin the layer");
}
GeoPackage::~GeoPackage() = default;

void GeoPackage::add(std::int64_t id, const Eigen::Vector3d& position, const std::vector<Value>& values) {
  const Gdal& api = gdal();
  const OGRFeatureH feature = api.OGR_F_Create(api.OGR_L_GetLayerDefn(impl_->layer));
  api.OGR_F_SetFID(feature, id);
  for (std::size_t n = 0; n < values.size(); ++n) {
    const int field = static_cast<int>(n);
    if (const auto* whole = std::get_if<std::int32_t>(&values[n])) api.OGR_F_SetFieldInteger(feature, field, *whole);
    if (const auto* real = std::get_if<double>(&values[n])) api.OGR_F_SetFieldDouble(feature, field, *real);
    if (const auto* text = std::get_if<std::string>(&values[n]))
      api.OGR_F_SetFieldString(feature, field, text->c_str());
    if (std::holds_alternative<std::monostate>(values[n])) api.OGR_F_SetFieldNull(feature, field);
  }
  const OGRGeometryH point = api.OGR_G_CreateGeometry(wkbPoint25D);
  api.OGR_G_SetPoint(point, 0, position.x(), position.y(), position.z());
  api.OGR_F_SetGeometryDirectly(feature, point);
  const OGRErr added = api.OGR_L_CreateFeature(impl_->layer, feature);
  api.OGR_F_Destroy(feature);
  if (added != OGRERR_NONE) failOf("add a point");
}

void GeoPackage::write(std::ostream& out) {
  if (gdal().GDALDatasetCommitTransaction(impl_->data.get()) != OGRERR_NONE || !impl_->data.close())
    failOf("end the layer");
  impl_->file.copyTo(out);
}

}  // namespace accessvdb::gis
