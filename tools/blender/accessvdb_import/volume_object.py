# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""field.vdb as a volume object aligned with the points."""

import os

import bpy
from mathutils import Matrix, Vector

from .materials import fog_material
from .points_ply import FieldError
from .vdb_header import check_volume

#: The fogs that every field has; a file without them is not ours.
FOGS = ("density", "accessible", "blocked")
# Up to 4.4, Blender draws voxel ijk in the cell from ijk to ijk + 1, not around it as in OpenVDB
# (Blender's pull request 138449).
_DRAWS_AROUND_VOXEL = (4, 5, 0)


def add_volume(collection, path, voxel_size_m):
    """New volume object in the field's local frame. Raises FieldError for a file without a field."""
    check_volume(path, FOGS)
    volume = bpy.data.volumes.new(os.path.basename(path))
    try:
        volume.filepath = path
        if not volume.grids.load():
            raise FieldError(f"{path}: {volume.grids.error_message or 'cannot be read'}. Copy or compute it again")
        density = next(grid for grid in volume.grids if grid.name == FOGS[0])
        matrix_L = _grid_to_field(density.matrix_object, voxel_size_m, path)
    except FieldError:
        bpy.data.volumes.remove(volume)
        raise
    volume.materials.append(fog_material(voxel_size_m))
    volume.display.density = 1.0 / voxel_size_m
    thing = bpy.data.objects.new("Accessibility volume", volume)
    thing.matrix_world = matrix_L
    collection.objects.link(thing)
    return thing


def _grid_to_field(grid_matrix, voxel_size_m, path):
    """Matrix of the object: undoes a rotated grid (y up for Houdini), and Blender's half voxel."""
    axes = grid_matrix.to_3x3() * (1.0 / voxel_size_m)
    if max(abs(value) for row in (axes @ axes.transposed() - Matrix.Identity(3)) for value in row) > 1e-4:
        raise FieldError(f"{path}: its voxels are not {voxel_size_m} m, as points.ply next to it says: the two are  "
                         "from different runs. Compute the field again")
    turn = axes.transposed().to_4x4()
    half_voxel = 0.5 * voxel_size_m if bpy.app.version < _DRAWS_AROUND_VOXEL else 0.0
    return Matrix.Translation(Vector((-half_voxel,) * 3)) @ turn
