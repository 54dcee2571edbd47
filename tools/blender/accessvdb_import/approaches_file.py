# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Reads approaches.json of `accessvdb approaches`: where to go first, and how. Needs NumPy, not Blender."""

import json
import os
import re
from dataclasses import dataclass

import numpy as np

from .points_ply import FieldError
from .tool_frame import rotation_of

FILE = "approaches.json"
POSES = ("pre_contact", "contact", "retreat")
_ADVICE = "Use the file as accessvdb approaches wrote it"
_WHICH = "Choose the output folder of accessvdb approaches"
_SAME_PLACE_M = 1e-6  # both files have positions as doubles, to the last digit
_LONGEST_WAY_M = 1000.0  # of one tool's way
_LONGEST_NAME = 32


@dataclass
class Target:
    """A point to go to. For each way in, `approaches` has the names of its poses and their (4, 4) matrices, world from
    tool."""

    number: int
    point: int
    position_W: np.ndarray
    tool: str
    why: str
    approaches: list

    def is_in(self, points):
        """Whether it is this very point of a field."""
        if self.point >= len(points):
            return False
        record = points.records[self.point]
        place = np.array([record["x"], record["y"], record["z"]])
        return bool(np.linalg.norm(place - self.position_W) <= _SAME_PLACE_M)


def read_targets(path):
    """The targets of an approaches.json, or of the folder with it. Raises FieldError for any other file, numbers that
    are not finite, and orientations that are not unit quaternions."""
    path = os.path.join(path, FILE) if os.path.isdir(path) else path
    if not os.path.isfile(path):
        raise FieldError(f"{path}: there is no such file. {_WHICH}")
    try:
        with open(path, encoding="utf-8") as stream:
            content = json.load(stream)
        targets = content["targets"]
        if not isinstance(targets, list):
            raise TypeError
    except OSError as error:
        raise FieldError(f"{path}: {error.strerror or error}. {_WHICH}") from None
    except (ValueError, KeyError, TypeError):
        raise FieldError(f"{path}: is no list of approaches. {_ADVICE}") from None
    return [_target(number, target, path) for number, target in enumerate(targets)]


def of_another_map(target, path):
    """FieldError about a target that is no point of the field."""
    place = " ".join(f"{value:.3f}" for value in target.position_W)
    return FieldError(f"{path}: is of another map: target {target.number} is point {target.point} at {place}, which "
                      "the field does not have. Run accessvdb approaches on the checkpoint of this map")


def tool_index(points, name):
    """Of several tools of a field, the one with this name; 0 for the only one. Raises FieldError if there is none."""
    names = [each for each in points.comments.get("tools", "").split(",") if each]
    if not names:
        names = [_name_of_only_tool(points.comments.get("tool", ""))]
    if name not in names:
        raise FieldError(f"The approach is for the tool {name}, which is none of the run: {', '.join(names)}. Choose its "
                         "mesh, with its unit, tip, axis and up")
    return names.index(name)


def _name_of_only_tool(tool):
    """As `accessvdb approaches` calls it."""
    stem = tool[len("builtin:"):] if tool.startswith("builtin:") else os.path.splitext(os.path.basename(tool))[0]
    return re.sub("[^A-Za-z0-9_-]", "_", stem)[:_LONGEST_NAME]


def _target(number, json_target, path):
    where = f"targets[{number}]"
    try:
        point, tool, why = json_target["point"], json_target["tool"], json_target["why"]
        position_W = _numbers(json_target["position"], 3)
        ways = list(json_target["approaches"])
        if type(point) is not int or point < 0 or not isinstance(tool, str) or not isinstance(why, str) or not ways:
            raise ValueError
        approaches = []
        for way, approach in enumerate(ways):
            where = f"targets[{number}].approaches[{way}]"
            approaches.append({name: _matrix(approach[name], position_W, name) for name in POSES})
    except FieldError as error:
        raise FieldError(f"{path}: {error} at {where}. {_ADVICE}") from None
    except (KeyError, TypeError, ValueError):
        raise FieldError(f"{path}: is no list of approaches: values are missing or no finite numbers at {where}. "
                         f"{_ADVICE}") from None
    return Target(number, point, position_W, tool, why, approaches)


def _numbers(values, count):
    if not isinstance(values, list) or any(type(value) not in (int, float) for value in values):
        raise ValueError
    array = np.array(values, dtype=float)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError
    return array


def _matrix(pose, position_W, name):
    matrix = np.eye(4)
    matrix[:3, 3] = _numbers(pose["position"], 3)
    matrix[:3, :3] = rotation_of(_numbers(pose["orientation_wxyz"], 4))
    if not np.linalg.norm(matrix[:3, 3] - position_W) <= (_SAME_PLACE_M if name == "contact" else _LONGEST_WAY_M):
        raise FieldError(f"the pose {name} is not at its target")
    return matrix
