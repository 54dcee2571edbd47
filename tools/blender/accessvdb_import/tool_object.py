# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Tool meshes as objects whose data are in the tool frame: metres, tip at the origin, +x along the body, +z up."""

import os

import bpy
import numpy as np

from .builtin_tools import builtin_mesh
from .materials import tool_material
from .points_ply import FieldError
from .tool_frame import vertices_in_tool_frame


def tool_mesh(source, pose):
    """New mesh from a mesh file or a built-in name. Raises FieldError."""
    if source.startswith("builtin:"):
        vertices, faces = builtin_mesh(source)
    else:
        vertices_M, faces = _read_mesh(source)
        vertices = vertices_in_tool_frame(vertices_M, pose).tolist()
    mesh = bpy.data.meshes.new(f"Tool {os.path.basename(source)}")
    mesh.from_pydata(vertices, [], faces)
    mesh.validate()
    mesh.update()
    mesh.materials.append(tool_material())
    return mesh


def _read_mesh(path):
    """Vertices as in the file, (n, 3), and faces, of all meshes of a file, read by Blender's own importers."""
    if not os.path.isfile(path):
        raise FieldError(f"{path}: there is no such file. Choose a tool mesh")
    kind = os.path.splitext(path)[1].lower()
    if kind not in _IMPORTERS:
        raise FieldError(f"{path}: '{kind}' tools are not supported here. Convert it to STL, OBJ or PLY")
    selected, active = list(bpy.context.selected_objects), bpy.context.view_layer.objects.active
    known = {collection: set(collection) for collection in
             (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.images)}
    try:
        _IMPORTERS[kind](path)
        things = [thing for thing in bpy.data.objects if thing not in known[bpy.data.objects]]
        return _joined(things, path)
    except (RuntimeError, AttributeError, ValueError, TypeError) as error:
        raise FieldError(f"{path}: cannot be read as a mesh ({_reason(error)}). Export it again") from None
    finally:
        for collection, before in known.items():
            for thing in [thing for thing in collection if thing not in before]:
                collection.remove(thing)
        for thing in bpy.context.selected_objects:
            thing.select_set(False)
        for thing in selected:
            thing.select_set(True)
        bpy.context.view_layer.objects.active = active


def _reason(error):
    """The line with the cause of an importer's failure, out of a possible traceback."""
    lines = [line.strip() for line in str(error).splitlines() if line[:1].strip()]
    lines = [line for line in lines if not line.startswith("Location:") and "Traceback" not in line]
    return lines[-1] if lines else type(error).__name__


def _joined(things, path):
    bpy.context.view_layer.update()
    vertices, faces = [np.zeros((0, 3))], []
    for thing in things:
        if thing.type != "MESH":
            continue
        base = sum(len(block) for block in vertices)
        local = np.empty(3 * len(thing.data.vertices), np.float32)
        thing.data.vertices.foreach_get("co", local)
        matrix = np.array(thing.matrix_world)
        vertices.append(local.reshape(-1, 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3])
        faces += [tuple(base + v for v in polygon.vertices) for polygon in thing.data.polygons]
    if not faces:
        raise FieldError(f"{path}: the mesh has no faces. Export the tool as a surface of triangles or polygons")
    return np.concatenate(vertices), faces


def _import_stl(path):
    if hasattr(bpy.ops.wm, "stl_import") and bpy.app.version >= (4, 1, 0):
        bpy.ops.wm.stl_import(filepath=path, forward_axis="Y", up_axis="Z")
    else:
        bpy.ops.import_mesh.stl(filepath=path, axis_forward="Y", axis_up="Z")


def _import_obj(path):
    bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")


def _import_ply(path):
    if bpy.app.version >= (3, 6, 0):
        bpy.ops.wm.ply_import(filepath=path, forward_axis="Y", up_axis="Z")
    else:
        bpy.ops.import_mesh.ply(filepath=path)


# Not glTF: Blender turns its axes, and the importer of Debian's Blender 3.4.1 fails with Debian's NumPy.
_IMPORTERS = {".stl": _import_stl, ".obj": _import_obj, ".ply": _import_ply}
