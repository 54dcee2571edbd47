# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What the operators that place a tool share: which tool it is, and that it takes the place of the one before."""

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatVectorProperty, StringProperty
from mathutils import Matrix

from .field_folder import find_field, tool_of_run
from .import_operator import field_root
from .points_ply import LABELS, REASONS, FieldError, read_points
from .tool_frame import ToolPose
from .tool_object import tool_mesh


class ToolChoice:
    """Properties of an operator that places a tool."""

    source: EnumProperty(name="Tool", items=(
        ("RUN", "The run's tool", "The tool, unit and pose that report.json names; of several tools the one that fits there"),
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

    def draw_tool(self):
        for name in ("source",) + (("tool", "unit", "tip", "axis", "up") if self.source == "FILE" else ()) + ("keep",):
            self.layout.prop(self, name)

    def field_of(self, thing):
        """The empty of the field that an object belongs to, the FieldFolder, and its Points. Raises FieldError."""
        root = field_root(thing)
        if root is None:
            raise FieldError("Select an object of an imported accessibility field first")
        field = find_field(root["accessvdb_folder"])
        points = read_points(field.points)
        _check_same_run(root, points)
        return root, field, points

    def mesh_of(self, field, index_of_run_tool):
        """New mesh of the chosen tool. @param index_of_run_tool  called for it where it is the run's. Raises FieldError."""
        if self.source == "RUN":
            return tool_mesh(*tool_of_run(field, index_of_run_tool()))
        if self.source == "FILE":
            if not self.tool:
                raise FieldError("No tool mesh is chosen. Choose a file, or one of the other tools")
            pose = ToolPose(self.unit, tuple(self.tip), tuple(self.axis), tuple(self.up))
            return tool_mesh(bpy.path.abspath(self.tool), pose)
        return tool_mesh(f"builtin:{self.source.lower()}", ToolPose())

    def put(self, root, mesh, name, matrix_L, point):
        """New object of a tool at a point, in the field's local frame."""
        if not self.keep:
            _remove_tools(root)
        thing = bpy.data.objects.new(name, mesh)
        thing["accessvdb_point"] = point
        root.users_collection[0].objects.link(thing)
        thing.parent = root
        thing.matrix_local = Matrix(matrix_L.tolist())
        return thing

    def warn_unless_accessible(self, points, index, more):
        record = points.records[index]
        if record["label"] != LABELS.index("accessible"):
            label, reason = LABELS[record["label"]], REASONS[record["reason"]]
            self.report({"WARNING"}, f"Point {index} is {label} (reason: {reason}); {more}")


def selected_vertices(thing):
    """Which vertices of a mesh are selected, in edit mode too: (n,) of bool."""
    if thing.mode == "EDIT":
        thing.update_from_editmode()
    selected = np.empty(len(thing.data.vertices), bool)
    thing.data.vertices.foreach_get("select", selected)
    return selected


def _check_same_run(root, points):
    """The files may have been rewritten since they were imported."""
    for thing in root.children:
        if thing.type == "MESH" and "label" in thing.data.attributes and len(thing.data.vertices) != len(points):
            raise FieldError(f"points.ply has {len(points)} points now, {len(thing.data.vertices)} were imported. "
                             "Import the field again")
    if not np.array_equal(points.origin_W, np.array(root["accessvdb_origin_W"])):
        raise FieldError("points.ply now has a different origin than when it was imported. Import the field again")


def _remove_tools(root):
    for thing in list(root.children):
        if "accessvdb_point" in thing:
            mesh = thing.data
            bpy.data.objects.remove(thing)
            if mesh.users == 0:
                bpy.data.meshes.remove(mesh)


_MENUS = ("VIEW3D_MT_object", "VIEW3D_MT_edit_mesh_vertices")


def register_in_menus(operator, entry):
    """An operator that places a tool, with its entry where points and arrows are selected."""
    bpy.utils.register_class(operator)
    for menu in _MENUS:
        getattr(bpy.types, menu).append(entry)


def unregister_in_menus(operator, entry):
    for menu in _MENUS:
        getattr(bpy.types, menu).remove(entry)
    bpy.utils.unregister_class(operator)
