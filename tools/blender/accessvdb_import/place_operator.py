# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Object > Place tool at point (AccessVDB): places the tool where it fits best according to the field."""

import bpy
import numpy as np
from bpy.props import IntProperty

from .points_ply import FieldError
from .tool_choice import ToolChoice, register_in_menus, selected_vertices, unregister_in_menus
from .tool_frame import placement_L


class OBJECT_OT_accessvdb_place_tool(ToolChoice, bpy.types.Operator):
    """Place the tool at a surface point, along the best direction found there"""

    bl_idname = "object.accessvdb_place_tool"
    bl_label = "Place tool at point"
    bl_options = {"REGISTER", "UNDO"}

    point: IntProperty(name="Point", default=-1, min=-1, description="Row of points.ply; -1: the selected vertex")

    def draw(self, _context):
        self.layout.prop(self, "point")
        self.draw_tool()

    def execute(self, context):
        try:
            root, field, points = self.field_of(context.active_object)
            index = self.point if self.point >= 0 else _selected_vertex(context.active_object)
            matrix_L = placement_L(points, index)
            mesh = self.mesh_of(field, lambda: points.best_tool(index))
        except FieldError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.put(root, mesh, f"Tool at point {index}", matrix_L, index)
        self.warn_unless_accessible(points, index, "its direction is the one that came closest")
        return {"FINISHED"}


def _selected_vertex(thing):
    if thing.type != "MESH" or "label" not in thing.data.attributes:
        raise FieldError("No point is chosen. Enter its number, or select one vertex of the points in edit mode")
    selected = selected_vertices(thing)
    if selected.sum() != 1:
        raise FieldError(f"{selected.sum()} vertices are selected. Select one in edit mode, or enter the point's number")
    return int(np.argmax(selected))


def _menu(self, _context):
    self.layout.operator(OBJECT_OT_accessvdb_place_tool.bl_idname, text="Place tool at point (AccessVDB)")


def register():
    register_in_menus(OBJECT_OT_accessvdb_place_tool, _menu)


def unregister():
    unregister_in_menus(OBJECT_OT_accessvdb_place_tool, _menu)
