# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Object > Place tool at approach (AccessVDB): places the tool in a pose that `accessvdb approaches` proposed."""

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty

from .approaches_file import read_targets, tool_index
from .arrows_object import APPROACH, TARGET
from .points_ply import FieldError
from .tool_choice import ToolChoice, register_in_menus, selected_vertices, unregister_in_menus


class OBJECT_OT_accessvdb_place_approach(ToolChoice, bpy.types.Operator):
    """Place the tool in a pose of an approach: before, at or after contact"""

    bl_idname = "object.accessvdb_place_approach"
    bl_label = "Place tool at approach"
    bl_options = {"REGISTER", "UNDO"}

    target: IntProperty(name="Target", default=-1, min=-1,
                        description="As in approaches.csv; -1: that of the selected arrow")
    approach: IntProperty(name="Approach", default=0, min=0,
                          description="Of the target, the first is 0; with target -1 that of the selected arrow")
    pose: EnumProperty(name="Pose", default="contact", items=(
        ("pre_contact", "Pre-contact", "Before contact, straight back along the body"),
        ("contact", "Contact", "The tip is at the point"),
        ("retreat", "Retreat", "After contact")))

    def draw(self, _context):
        for name in ("target", "approach", "pose"):
            self.layout.prop(self, name)
        self.draw_tool()

    def execute(self, context):
        try:
            root, field, points = self.field_of(context.active_object)
            targets = _targets_of(root, points)
            number, way = (self.target, self.approach) if self.target >= 0 else _selected_arrow(context.active_object)
            target = targets.get(number)
            if target is None:
                raise FieldError(f"There is no target {number} here. Choose one of {', '.join(map(str, targets))}")
            if way >= len(target.approaches):
                raise FieldError(f"Target {number} has no approach {way}: it has {len(target.approaches)}, counted from "
                                 "0")
            matrix_L = target.approaches[way][self.pose].copy()
            matrix_L[:3, 3] -= points.origin_W
            mesh = self.mesh_of(field, lambda: tool_index(points, target.tool))
        except FieldError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        thing = self.put(root, mesh, f"Tool at target {number}, approach {way}", matrix_L, target.point)
        thing["accessvdb_target"], thing["accessvdb_approach"] = number, way
        thing["accessvdb_pose"] = self.pose
        self.report({"INFO"}, f"Target {number}, approach {way} of {len(target.approaches)}: {target.why}")
        self.warn_unless_accessible(points, target.point, "the approaches are of another state of the map")
        return {"FINISHED"}


def _targets_of(root, points):
    """Number to target, of those that are in this field. Raises FieldError."""
    if "accessvdb_approaches" not in root:
        raise FieldError("The field was imported without approaches. Import it with its approaches.json")
    path = root["accessvdb_approaches"]
    targets = {target.number: target for target in read_targets(path) if target.is_in(points)}
    # The file may have been rewritten since it was imported.
    for thing in root.children:
        if thing.type == "MESH" and TARGET in thing.data.attributes and APPROACH in thing.data.attributes:
            imported = set(zip(_values(thing, TARGET), _values(thing, APPROACH)))
            now = {(target.number, way) for target in targets.values() for way in range(len(target.approaches))}
            if imported != now:
                raise FieldError(f"{path}: has other approaches than when it was imported. Import the field again")
    return targets


def _values(thing, name):
    values = np.empty(len(thing.data.vertices), np.int32)
    thing.data.attributes[name].data.foreach_get("value", values)
    return values.tolist()


def _selected_arrow(thing):
    if thing.type != "MESH" or TARGET not in thing.data.attributes or APPROACH not in thing.data.attributes:
        raise FieldError("No approach is chosen. Enter the target's number, or select a vertex of an arrow in edit "
                         "mode")
    selected = selected_vertices(thing)
    arrows = {pair for pair, chosen in zip(zip(_values(thing, TARGET), _values(thing, APPROACH)), selected) if chosen}
    if len(arrows) != 1:
        raise FieldError(f"Vertices of {len(arrows)} arrows are selected. Select those of one in edit mode, or enter "
                         "the target's number")
    return arrows.pop()


def _menu(self, _context):
    self.layout.operator(OBJECT_OT_accessvdb_place_approach.bl_idname, text="Place tool at approach (AccessVDB)")


def register():
    register_in_menus(OBJECT_OT_accessvdb_place_approach, _menu)


def unregister():
    unregister_in_menus(OBJECT_OT_accessvdb_place_approach, _menu)
