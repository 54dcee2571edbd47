# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Types of the module. tests/python/stub_test.py checks every name and argument against the module itself.
import enum
import os
from typing import Any, Dict, Iterator, List, Literal, Mapping, Optional, Sequence, Tuple, Union, final

import numpy as np
import numpy.typing as npt

__version__: str

_Path = Union[str, os.PathLike[str]]
_Unit = Literal["m", "cm", "mm", "in"]
_Backend = Literal["auto", "cpu", "cuda"]
_Region = Literal["double_cone", "full_cube", "projective"]
_Form = Literal["voxels", "surface_samples"]
_Policy = Literal["exact", "paper"]
_PoseFormat = Literal["auto", "tum", "kitti", "balm", "hba", "viewpoint"]
_Compression = Literal["auto", "blosc", "zip", "none"]
_UpAxis = Literal["z", "y"]
_Three = Union[Sequence[float], npt.NDArray[Any]]
_F32 = npt.NDArray[np.float32]
_F64 = npt.NDArray[np.float64]
_U8 = npt.NDArray[np.uint8]
_U16 = npt.NDArray[np.uint16]
_U32 = npt.NDArray[np.uint32]
_Bool = npt.NDArray[np.bool_]

NO_SCORE: int
NO_DIRECTION: int
NO_POINT: int

class Error(Exception):
    code: int
    id: str
    subject: str
    problem: str
    advice: str
    def __init__(self, id: str, subject: str, problem: str, advice: str = ...) -> None: ...

class InvalidArgument(Error, ValueError): ...
class InputError(Error): ...
class UnusableInput(Error): ...
class ResourceLimit(Error, MemoryError): ...
class DeviceError(Error): ...
class OutputError(Error): ...
class InternalError(Error): ...

class PointLabel(enum.IntEnum):
    UNSCORED = 0
    ACCESSIBLE = 1
    BLOCKED = 2

class PointReason(enum.IntEnum):
    NONE = 0
    CONFIDENCE = 1
    NORMAL = 2
    UNSEEN = 3
    UNKNOWN = 4
    ARM = 5
    TOOL = 6

class ProjectiveParams:
    bin_rad: float
    in_front: bool
    empty_is_free: bool
    guarded: bool
    cleared_band: bool
    elevation_min_rad: float
    elevation_max_rad: float
    @property
    def box_min_W_m(self) -> Tuple[float, float, float]: ...
    @box_min_W_m.setter
    def box_min_W_m(self, value: _Three) -> None: ...
    @property
    def box_max_W_m(self) -> Tuple[float, float, float]: ...
    @box_max_W_m.setter
    def box_max_W_m(self, value: _Three) -> None: ...
    def __init__(
        self,
        *,
        bin_rad: float = ...,
        in_front: bool = ...,
        empty_is_free: bool = ...,
        guarded: bool = ...,
        cleared_band: bool = ...,
        elevation_min_rad: float = ...,
        elevation_max_rad: float = ...,
        box_min_W_m: _Three = ...,
        box_max_W_m: _Three = ...,
    ) -> None: ...
    def __copy__(self) -> ProjectiveParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> ProjectiveParams: ...

class TsdfParams:
    voxel_size_m: float
    truncation_distance_m: float
    range_noise_m: float
    min_range_m: float
    max_range_m: float
    region: _Region
    projective: ProjectiveParams
    cone_cos_min: float
    clamp_min_m: float
    max_weight: int
    cleared_radius_voxels: float
    cleared_begin_tau: float
    cleared_end_tau: float
    def __init__(
        self,
        *,
        voxel_size_m: float = ...,
        truncation_distance_m: float = ...,
        range_noise_m: float = ...,
        min_range_m: float = ...,
        max_range_m: float = ...,
        region: _Region = ...,
        projective: Union[ProjectiveParams, Mapping[str, Any]] = ...,
        cone_cos_min: float = ...,
        clamp_min_m: float = ...,
        max_weight: int = ...,
        cleared_radius_voxels: float = ...,
        cleared_begin_tau: float = ...,
        cleared_end_tau: float = ...,
    ) -> None: ...
    def __copy__(self) -> TsdfParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> TsdfParams: ...

class ApproachParams:
    num_directions: int
    normal_cone_rad: float
    observation_cos_min: float
    @property
    def arm_tau(self) -> Tuple[float, float, float]: ...
    @arm_tau.setter
    def arm_tau(self, value: _Three) -> None: ...
    corridor_length_m: float
    coarse_to_fine: bool
    viewpoints: bool
    def __init__(
        self,
        *,
        num_directions: int = ...,
        normal_cone_rad: float = ...,
        observation_cos_min: float = ...,
        arm_tau: _Three = ...,
        corridor_length_m: float = ...,
        coarse_to_fine: bool = ...,
        viewpoints: bool = ...,
    ) -> None: ...
    def __copy__(self) -> ApproachParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> ApproachParams: ...

class ScoringParams:
    collision_distance_m: float
    self_exclusion_voxels: float
    form: _Form
    surface_samples: int
    max_collisions: int
    neighbours: int
    mean_positions: bool
    join_neighbour_views: bool
    neighbourhood_weight: bool
    confidence_half_weight: float
    confidence_min: float
    def __init__(
        self,
        *,
        collision_distance_m: float = ...,
        self_exclusion_voxels: float = ...,
        form: _Form = ...,
        surface_samples: int = ...,
        max_collisions: int = ...,
        neighbours: int = ...,
        mean_positions: bool = ...,
        join_neighbour_views: bool = ...,
        neighbourhood_weight: bool = ...,
        confidence_half_weight: float = ...,
        confidence_min: float = ...,
    ) -> None: ...
    def __copy__(self) -> ScoringParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> ScoringParams: ...

class UpdateParams:
    policy: _Policy
    budget_points: int
    changed_voxel_sample: int
    changed_voxel_radius_voxels: float
    requeue_motion_m: float
    stability_min: float
    seed: int
    def __init__(
        self,
        *,
        policy: _Policy = ...,
        budget_points: int = ...,
        changed_voxel_sample: int = ...,
        changed_voxel_radius_voxels: float = ...,
        requeue_motion_m: float = ...,
        stability_min: float = ...,
        seed: int = ...,
    ) -> None: ...
    def __copy__(self) -> UpdateParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> UpdateParams: ...

class FieldParams:
    """Everything that an AccessibilityField needs besides the tool. Nested structs can be given as dicts."""

    tsdf: TsdfParams
    approach: ApproachParams
    scoring: ScoringParams
    update: UpdateParams
    backend: _Backend
    threads: int
    mirror_distance: bool
    def __init__(
        self,
        *,
        tsdf: Union[TsdfParams, Mapping[str, Any]] = ...,
        approach: Union[ApproachParams, Mapping[str, Any]] = ...,
        scoring: Union[ScoringParams, Mapping[str, Any]] = ...,
        update: Union[UpdateParams, Mapping[str, Any]] = ...,
        backend: _Backend = ...,
        threads: int = ...,
        mirror_distance: bool = ...,
    ) -> None: ...
    @staticmethod
    def paper(voxel_size_m: float) -> FieldParams: ...
    def resolved(self) -> FieldParams: ...
    def describe(self) -> str: ...
    def __copy__(self) -> FieldParams: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> FieldParams: ...

@final
class ToolGeometry:
    """A tool as a triangle mesh: metres, tip at the origin, +x from the tip along the body, +z up."""

    @staticmethod
    def from_mesh(
        path: _Path, unit: Optional[_Unit] = ..., *, tip: Optional[_Three] = ..., axis: _Three = ..., up: _Three = ...
    ) -> ToolGeometry: ...
    @staticmethod
    def from_triangles(vertices_T: npt.ArrayLike, triangles: npt.ArrayLike, name: str = ...) -> ToolGeometry: ...
    @staticmethod
    def builtin(name: str) -> ToolGeometry: ...
    @property
    def vertices_T(self) -> _F32: ...
    @property
    def triangles(self) -> _U32: ...
    @property
    def name(self) -> str: ...
    @property
    def sha256(self) -> str: ...
    @property
    def notes(self) -> List[str]: ...
    @property
    def watertight(self) -> bool: ...
    @property
    def min_T(self) -> _F64: ...
    @property
    def max_T(self) -> _F64: ...
    @property
    def reach_m(self) -> float: ...

@final
class SurfacePoint:
    @property
    def id(self) -> int: ...
    @property
    def position_W(self) -> _F64: ...
    @property
    def normal_W(self) -> _F32: ...
    @property
    def direction_W(self) -> _F32: ...
    @property
    def yaw_rad(self) -> float: ...
    @property
    def direction(self) -> int: ...
    @property
    def score(self) -> int: ...
    @property
    def weight(self) -> float: ...
    @property
    def confidence(self) -> float: ...
    @property
    def stability(self) -> float: ...
    @property
    def label(self) -> PointLabel: ...
    @property
    def reason(self) -> PointReason: ...
    @property
    def confident(self) -> bool: ...

@final
class FieldSnapshot:
    """All surface points at one moment. Columns are read-only views without a copy; they keep the snapshot alive."""

    @property
    def id(self) -> _U32: ...
    @property
    def position_W(self) -> _F64: ...
    @property
    def normal_W(self) -> _F32: ...
    @property
    def direction_W(self) -> _F32: ...
    @property
    def yaw_rad(self) -> _F32: ...
    @property
    def direction(self) -> _U16: ...
    @property
    def score(self) -> _U16: ...
    @property
    def weight(self) -> _F32: ...
    @property
    def confidence(self) -> _F32: ...
    @property
    def stability(self) -> _F32: ...
    @property
    def label(self) -> _U8: ...
    @property
    def reason(self) -> _U8: ...
    @property
    def confident(self) -> _Bool: ...
    @property
    def records(self) -> npt.NDArray[np.void]: ...
    @property
    def origin_W(self) -> _F64: ...
    @property
    def voxel_size_m(self) -> float: ...
    @property
    def counts(self) -> Dict[str, int]: ...
    @property
    def reasons(self) -> Dict[str, int]: ...
    def __len__(self) -> int: ...

@final
class PointAnswers:
    """What a field knows at the given positions, in their order. Columns are read-only views."""

    @property
    def distance_m(self) -> _F32: ...
    @property
    def point_distance_m(self) -> _F32: ...
    @property
    def direction_W(self) -> _F32: ...
    @property
    def point_id(self) -> _U32: ...
    @property
    def weight(self) -> _U16: ...
    @property
    def direction(self) -> _U16: ...
    @property
    def score(self) -> _U16: ...
    @property
    def label(self) -> _U8: ...
    @property
    def reason(self) -> _U8: ...
    @property
    def unknown(self) -> _Bool: ...
    @property
    def cleared(self) -> _Bool: ...
    @property
    def records(self) -> npt.NDArray[np.void]: ...
    def __len__(self) -> int: ...

@final
class CapsuleAnswers:
    """What the given capsules meet, in their order. Columns are read-only views."""

    @property
    def min_distance_m(self) -> _F32: ...
    @property
    def first_hit_t(self) -> _F32: ...
    @property
    def collision(self) -> _Bool: ...
    @property
    def unknown(self) -> _Bool: ...
    @property
    def valid(self) -> _Bool: ...
    @property
    def free(self) -> _Bool: ...
    @property
    def records(self) -> npt.NDArray[np.void]: ...
    def __len__(self) -> int: ...

@final
class FrameStats:
    @property
    def points_in(self) -> int: ...
    @property
    def points_used(self) -> int: ...
    @property
    def dropped(self) -> Dict[str, int]: ...
    @property
    def touched_leaves(self) -> int: ...
    @property
    def new_leaves(self) -> int: ...
    @property
    def distance_updates(self) -> int: ...
    @property
    def cleared_updates(self) -> int: ...
    @property
    def integrate_ms(self) -> float: ...
    @property
    def mirror_ms(self) -> float: ...
    @property
    def changed_leaves(self) -> int: ...
    @property
    def mirror_bytes(self) -> int: ...
    @property
    def surface_points(self) -> int: ...

@final
class UpdateStats:
    @property
    def dirty_points(self) -> int: ...
    @property
    def scored_points(self) -> int: ...
    @property
    def direction_tests(self) -> int: ...
    @property
    def backlog(self) -> int: ...
    @property
    def label_changes(self) -> int: ...
    @property
    def update_ms(self) -> float: ...
    @property
    def score_ms(self) -> float: ...

@final
class MemoryUse:
    @property
    def map_bytes(self) -> int: ...
    @property
    def mirror_bytes(self) -> int: ...
    @property
    def point_host_bytes(self) -> int: ...
    @property
    def point_device_bytes(self) -> int: ...
    @property
    def device_peak_bytes(self) -> int: ...
    @property
    def leaves(self) -> int: ...
    @property
    def active_voxels(self) -> int: ...

@final
class ScanRecord:
    """One step: points_S with T_W_S, or, for a ray cloud, points_W with origins_W."""

    @property
    def points_S(self) -> _F32: ...
    @property
    def T_W_S(self) -> _F64: ...
    @property
    def points_W(self) -> _F64: ...
    @property
    def origins_W(self) -> _F64: ...
    @property
    def stamp_s(self) -> float: ...
    @property
    def path(self) -> str: ...
    @property
    def truncated_points(self) -> int: ...

@final
class ScanSequence:
    """Scans with their poses, in order; files are read on demand."""

    def __init__(
        self,
        scans: _Path,
        poses: Optional[_Path] = ...,
        *,
        pose_format: _PoseFormat = ...,
        calib: Optional[_Path] = ...,
        sensor_at_W: Optional[_Three] = ...,
        every: int = ...,
        allow_truncated: bool = ...,
        sort_poses: bool = ...,
        rays_per_step: int = ...,
        trajectory: Optional[_Path] = ...,
        time_offset_s: float = ...,
        stations: Optional[_Path] = ...,
        laz_command: str = ...,
    ) -> None: ...
    def __len__(self) -> int: ...
    def __getitem__(self, step: int) -> ScanRecord: ...
    def __iter__(self) -> Iterator[ScanRecord]: ...
    @property
    def notices(self) -> List[str]: ...
    @property
    def matching_rule(self) -> str: ...
    @property
    def paths(self) -> List[str]: ...
    @property
    def recorded_range_noise_m(self) -> Optional[float]: ...

@final
class AccessibilityField:
    """Scans go in, labelled surface points come out. Calls from several threads take turns."""

    def __init__(
        self, tool: ToolGeometry, params: Union[FieldParams, Mapping[str, Any], None] = ...
    ) -> None: ...
    def integrate_scan(self, points_S: npt.ArrayLike, T_W_S: npt.ArrayLike) -> FrameStats: ...
    def integrate_rays(self, points_W: npt.ArrayLike, origins_W: npt.ArrayLike) -> FrameStats: ...
    def integrate(self, record: ScanRecord) -> FrameStats: ...
    def update(self) -> UpdateStats: ...
    def snapshot(self) -> FieldSnapshot: ...
    def evaluate_from_scratch(self) -> FieldSnapshot: ...
    def point_at(self, p_W: _Three) -> Optional[SurfacePoint]: ...
    def query(self, points_W: npt.ArrayLike) -> PointAnswers: ...
    def query_along(
        self, a_W: npt.ArrayLike, b_W: npt.ArrayLike, radius_m: Union[float, npt.ArrayLike]
    ) -> CapsuleAnswers: ...
    def write(
        self,
        folder: _Path,
        *,
        half_float: bool = ...,
        compression: _Compression = ...,
        up_axis: _UpAxis = ...,
        surface: bool = ...,
    ) -> None: ...
    def write_frame(
        self,
        file: _Path,
        *,
        half_float: bool = ...,
        compression: _Compression = ...,
        up_axis: _UpAxis = ...,
        surface: bool = ...,
    ) -> None: ...
    def memory_use(self) -> MemoryUse: ...
    @property
    def tool(self) -> ToolGeometry: ...
    @property
    def params(self) -> FieldParams: ...
    @property
    def origin_W(self) -> _F64: ...
    @property
    def device_name(self) -> str: ...
    @property
    def device_note(self) -> str: ...
    @property
    def tool_share_hidden(self) -> float: ...
    @property
    def collision_limit(self) -> int: ...

@final
class StoredAnswer:
    @property
    def position_W(self) -> _F64: ...
    @property
    def point(self) -> Optional[SurfacePoint]: ...
    @property
    def point_distance_m(self) -> float: ...
    @property
    def observed(self) -> bool: ...
    @property
    def cleared(self) -> bool: ...
    @property
    def distance_m(self) -> float: ...
    @property
    def weight(self) -> float: ...

@final
class StoredField:
    """A field read back from an output folder."""

    def __init__(self, folder: _Path) -> None: ...
    def at(self, p_W: _Three) -> StoredAnswer: ...
    @property
    def points(self) -> FieldSnapshot: ...

def read_points_ply(path: _Path) -> FieldSnapshot: ...
def render_field(
    png: _Path,
    snapshot: FieldSnapshot,
    *,
    width_px: int = ...,
    height_px: int = ...,
    view_W: _Three = ...,
    colour: Literal["label", "reason"] = ...,
) -> None: ...
def render_tool(
    png: _Path, tool: ToolGeometry, *, width_px: int = ..., height_px: int = ..., view_W: _Three = ...
) -> None: ...
