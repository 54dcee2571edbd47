# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Object > Place tool at point (AccessVDB): places the tool where it fits best according to the field."""

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatVectorProperty, IntProperty, StringProperty
from mathutils import Matrix

from .field_folder import find_field, tool_of_run
from .import_operator import field_root
from .points_ply import LABELS, REASONS, FieldError, read_points
from .tool_frame import ToolPose, placement_L
from .tool_object import tool_mesh


class OBJECT_OT_accessvdb_place_tool(bpy.types.Operator):
    """Place the tool at a surface point, along the best direction found there"""

    bl_idname = "object.accessvdb_place_tool"
    bl_label = "Place tool at point"
    bl_options = {"REGISTER", "UNDO"}

    point: IntProperty(name="Point", default=-1, min=-1, description="Row of points.ply; -1: the selected vertex")
    source: EnumProperty(name="Tool", items=(
        ("RUN", "The run's tool", "The tool, unit and pose that report.json names; of several tools the best one there"),
        ("FILE", "Mesh file", "A mesh with the unit and pose below"),
        ("PENCIL", "Pencil", "builtin:pencil"),
        ("PRUNER", "Pruner", "builtin:pruner")))
    tool: StringProperty(name="Mesh", subtype="FILE_PATH", description="STL, OBJ or PLY")
    unit: EnumProperty(name="Unit", default="mm", items=(
        ("m", "Metres", ""), ("cm", "Centimetres", ""), ("mm", "Millimetres", ""), ("in", "Inches", "")))
    tip: FloatVectorProperty(name="Tip", default=(0, 0, 0), precision=4,
                             description="Point of the tool that touches the surface, in the mesh's units and axes")
    axis: FloatVectorProperty(name="Axis", default=(1, 0, 0),
                              description="From the tip along the body, in the mesh's axes")
    up: FloatVectorProperty(name="Up", default=(0, 0, 1), description="What becomes up, in the mesh's axes")
    keep: BoolProperty(name="Keep earlier tools", default=False, description="Else the previous tool is removed")

    @classmethod
    def poll(cls, context):
        return field_root(context.active_object) is not None

    def draw(self, _context):
        for name in ("point", "source") + (("tool", "unit", "tip", "axis", "up") if self.source == "FILE" else ()):
            self.layout.prop(self, name)
        self.layout.prop(self, "keep")

    def execute(self, context):
        root = field_root(context.active_object)
        try:
            if root is None:
                raise FieldError("Select an object of an imported accessibility field first")
            field = find_field(root["accessvdb_folder"])
            points = read_points(field.points)
            self._check_same_run(root, points)
            index = self.point if self.point >= 0 else _selected_vertex(context.active_object)
            matrix_L = placement_L(points, index)
            mesh = self._mesh(field, points.best_tool(index))
        except FieldError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if not self.keep:
            _remove_tools(root)
        thing = bpy.data.objects.new(f"Tool at point {index}", mesh)
        thing["accessvdb_point"] = index
        root.users_collection[0].objects.link(thing)
        thing.parent = root
        thing.matrix_local = Matrix(matrix_L.tolist())
        record = points.records[index]
        if record["label"] != LABELS.index("accessible"):
            label, reason = LABELS[record["label"]], REASONS[record["reason"]]
            self.report({"WARNING"}, f"Point {index} is {label} (reason: {reason}); its direction is the one that came "
                                     "closest")
        return {"FINISHED"}

    def _mesh(self, field, best_tool):
        if self.source == "RUN":
            return tool_mesh(*tool_of_run(field, best_tool))
        if self.source == "FILE":
            if not self.tool:
                raise FieldError("No tool mesh is chosen. Choose a file, or one of the other tools")
            pose = ToolPose(self.unit, tuple(self.tip), tuple(self.axis), tuple(self.up))
            return tool_mesh(bpy.path.abspath(self.tool), pose)
        return tool_mesh(f"builtin:{self.source.lower()}", ToolPose())

    def _check_same_run(self, root, points):
        """The files may have been rewritten since they were imported."""
        for thing in root.children:
            if thing.type == "MESH" and "label" in thing.data.attributes and len(thing.data.vertices) != len(points):
                raise FieldError(f"points.ply has {len(points)} points now, {len(thing.data.vertices)} were imported. "
                                 "Import the field again")
        if not np.array_equal(points.origin_W, np.array(root["accessvdb_origin_W"])):
            raise FieldError("points.ply now has a different origin than when it was imported. Import the field again")


def _selected_vertex(thing):
    if thing.type != "MESH" or "label" not in thing.data.attributes:
        raise FieldError("No point is chosen. Enter its number, or select one vertex of the points in edit mode")
    if thing.mode == "EDIT":
        thing.update_from_editmode()
    selected = np.empty(len(thing.data.vertices), bool)
    thing.data.vertices.foreach_get("select", selected)
    if selected.sum() != 1:
        raise FieldError(f"{selected.sum()} vertices are selected. Select one in edit mode, or enter the point's number")
    return int(np.argmax(selected))


def _remove_tools(root):
    for thing in list(root.children):
        if "accessvdb_point" in thing:
            mesh = thing.data
            bpy.data.objects.remove(thing)
            if mesh.users == 0:
                bpy.data.meshes.remove(mesh)


def _menu(self, _context):
    self.layout.operator(OBJECT_OT_accessvdb_place_tool.bl_idname, text="Place tool at point (AccessVDB)")


_MENUS = ("VIEW3D_MT_object", "VIEW3D_MT_edit_mesh_vertices")


def register():
    bpy.utils.register_class(OBJECT_OT_accessvdb_place_tool)
    for menu in _MENUS:
        getattr(bpy.types, menu).append(_menu)


def unregister():
    for menu in _MENUS:
        getattr(bpy.types, menu).remove(_menu)
    bpy.utils.unregister_class(OBJECT_OT_accessvdb_place_tool)
