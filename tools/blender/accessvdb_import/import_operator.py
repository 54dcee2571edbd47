# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""File > Import > Accessibility field (AccessVDB)."""

import os

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from .approaches_file import FILE, of_another_map, read_targets
from .arrows_object import add_arrows
from .field_folder import find_fields
from .points_object import add_points
from .points_ply import FieldError, read_points
from .volume_object import add_volume

# Blender's coordinates are floats: beyond this they are coarser than a millimetre.
_FAR_AWAY_M = 10000.0


class IMPORT_SCENE_OT_accessvdb(bpy.types.Operator, ImportHelper):
    """Open the output folder of accessvdb map: volume, points and approaches"""

    bl_idname = "import_scene.accessvdb"
    bl_label = "Import accessibility field"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".vdb"
    filter_glob: StringProperty(default="*.vdb;*.ply;*.json", options={"HIDDEN"})
    with_volume: BoolProperty(name="Volume", default=True, description="field.vdb, as green and red fog")
    with_points: BoolProperty(name="Points", default=True, description="points.ply, as coloured balls with attributes")
    with_approaches: BoolProperty(name="Approaches", default=True,
                                  description="approaches.json, if there is one, as an arrow for each approach")
    approaches: StringProperty(name="From", subtype="FILE_PATH",
                               description="approaches.json, or its folder; empty: the one beside the field")
    at_world_position: BoolProperty(
        name="At its world position", default=True,
        description="Place the field at its world coordinates; else its local origin is Blender's origin")

    def execute(self, context):
        collection = bpy.data.collections.new("Accessibility field")
        labels = []
        try:
            fields = find_fields(bpy.path.abspath(self.filepath))
            collection.name = _name(fields[0].folder if len(fields) == 1 else _map_of_tile(fields[0].folder))
            folder = fields[0].folder if len(fields) == 1 else _map_of_tile(fields[0].folder)
            approaches = self._approaches_in(folder)
            targets = read_targets(approaches) if approaches else []
            found = set()
            for field in fields:
                part = collection
                if len(fields) > 1:
                    part = bpy.data.collections.new(f"{collection.name} {_name(field.folder)}")
                    collection.children.link(part)
                points = read_points(field.points)
                own = [target for target in targets if target.is_in(points)]
                found.update(target.number for target in own)
                self._fill(part, field, points, own, approaches)
                labels.append(points.records["label"])
            lost = [target for target in targets if target.number not in found]
            if lost:
                raise of_another_map(lost[0], approaches)
        except FieldError as error:
            _remove(collection)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.scene.collection.children.link(collection)
        labels = np.concatenate(labels)
        tiles = f" in {len(fields)} tiles" if len(fields) > 1 else ""
        self.report({"INFO"}, f"{len(labels)} surface points{tiles}: {(labels == 1).sum()} accessible, "
                              f"{(labels == 2).sum()} blocked, {(labels == 0).sum()} not scored")
        if len(labels) == 0:
            self.report({"WARNING"}, f"{fields[0].folder}: the field is empty")
        return {"FINISHED"}

    def _approaches_in(self, folder):
        """Path of the approaches to show; empty: none."""
        if not self.with_approaches:
            return ""
        if self.approaches:
            return bpy.path.abspath(self.approaches)
        beside = os.path.join(folder, FILE)
        return beside if os.path.isfile(beside) else ""

    def _fill(self, collection, field, points, targets, approaches):
        # First does what can fail, so that nothing is left behind.
        things = [add_volume(collection, field.volume, points.voxel_size_m)] if self.with_volume else []
        if self.with_points:
            things.append(add_points(collection, points))
        if targets:
            things.append(add_arrows(collection, targets, points.origin_W))
        root = bpy.data.objects.new(collection.name, None)
        root.empty_display_size = 10 * points.voxel_size_m
        root["accessvdb_folder"] = field.folder
        root["accessvdb_origin_W"] = [float(value) for value in points.origin_W]
        root["accessvdb_voxel_size_m"] = points.voxel_size_m
        if targets:
            root["accessvdb_approaches"] = os.path.abspath(approaches)
        collection.objects.link(root)
        for thing in things:
            thing.parent = root
        if self.at_world_position:
            if abs(points.origin_W).max() <= _FAR_AWAY_M:
                root.location = points.origin_W
            else:
                self.report({"WARNING"}, "The field is too far from the world's origin for Blender's coordinates; "
                                         "it is placed at Blender's origin, see the custom properties of the empty")


def _name(folder):
    return os.path.basename(folder) or "Accessibility field"


def _map_of_tile(folder):
    return os.path.dirname(os.path.dirname(folder))


def _remove(collection):
    """With everything in it; nothing else uses that yet."""
    for thing in list(collection.all_objects):
        bpy.data.objects.remove(thing)
    for part in list(collection.children):
        bpy.data.collections.remove(part)
    bpy.data.collections.remove(collection)


def field_root(thing):
    """The empty that a field's object belongs to, or None."""
    while thing is not None and "accessvdb_folder" not in thing:
        thing = thing.parent
    return thing


def _menu(self, _context):
    self.layout.operator(IMPORT_SCENE_OT_accessvdb.bl_idname, text="Accessibility field (AccessVDB)")


def register():
    bpy.utils.register_class(IMPORT_SCENE_OT_accessvdb)
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_accessvdb)
