# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every setting of the project, declared once: type, default, unit, range and meaning.

ROS parameters, the YAML files in `config/`, command-line help and the table in
`docs/parameters.md` are all derived from the dataclasses below. A setting's full name is
`group.field`, for example `crop.max_range_m`. The defaults are the `online` preset.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

from mnsf_ros.errors import SettingsError, did_you_mean, shortened
from mnsf_ros.setting import Setting, SettingValue, declared, settings_of


@dataclass(frozen=True)
class MethodSettings:
    """The method of the node."""

    name: str = declared(
        "online", "Method: online, mnsf or another one of docs/evaluation.md", fixed=True
    )


@dataclass(frozen=True)
class TimeSettings:
    """Times of the points of a cloud."""

    field: str = declared(
        "auto",
        "Field with the time of each point. auto: one of the usual names, else by the order of the "
        "points once they show that the lidar turns; none: no times; or its sense and where a "
        "sweep begins: clockwise:180, counterclockwise:-90 (azimuth in degrees)",
    )
    unit: str = declared(
        "auto",
        "Unit of that field. auto: the unit in which a sweep takes 0.002 to 2 s",
        choices=("auto", "s", "ms", "us", "ns"),
    )
    stamp: str = declared(
        "auto", "Point measured at the stamp; auto: by the values", choices=("auto", "start", "end")
    )

    @property
    def rotation(self) -> tuple[bool, float] | None:
        """Whether the lidar turns clockwise, and where it begins, of a `field` that says so.

        Raises:
            SettingsError: If it says no angle.
        """
        sense, _, start = self.field.partition(":")
        if sense not in ("clockwise", "counterclockwise"):
            return None
        with suppress(ValueError):
            if math.isfinite(float(start)):
                return sense == "clockwise", float(start) % 360.0
        raise SettingsError(
            f"time.field: got {self.field!r}, expected an azimuth in degrees: {sense}:180"
        )


@dataclass(frozen=True)
class CropSettings:
    """Points that methods are fitted to. Points outside still get a flow."""

    min_range_m: float = declared(
        0.5, "Exclude points nearer than this, for example on the robot itself", 0, 1000
    )
    max_range_m: float = declared(
        80.0, "Exclude points farther than this, in the horizontal plane", 1, 1000
    )
    min_height_m: float = declared(
        -20.0, "Exclude points below this height in the sensor frame", -1000, 1000
    )
    max_height_m: float = declared(
        4.0, "Exclude points above this height in the sensor frame", -1000, 1000
    )
    own_body: str = declared(
        "auto",
        "The robot itself. auto: what stays at its place within 2 m of the sensor while the robot "
        "moves; none; or boxes by x y z of two corners (m): -2 -1 -1 0 1 0; 0 -1 -1 1 1 0",
    )

    @property
    def own_boxes(self) -> tuple[tuple[float, ...], ...]:
        """The boxes of `own_body`, their lower corner before their upper one.

        Raises:
            SettingsError: If the text is no list of boxes.
        """
        if self.own_body in ("auto", "none"):
            return ()
        return tuple(map(self._box, self.own_body.split(";")))

    @staticmethod
    def _box(text: str) -> tuple[float, ...]:
        with suppress(ValueError):
            corners = [*map(float, text.split())]
            if len(corners) == 6 and all(map(math.isfinite, corners)):
                first, second = corners[:3], corners[3:]
                return (*map(min, first, second), *map(max, first, second))
        raise SettingsError(
            f"crop.own_body: got {text.strip()!r}, expected auto, none, or boxes with semi"
            "colons between, each as x y z of two opposite corners in metres"
        )


@dataclass(frozen=True)
class GroundSettings:
    """Ground detection. Ground carries no information about the motion of objects."""

    remove: bool = declared(
        True, "Exclude ground; disable only for clouds without it, else objects merge over it"
    )
    cell_size_m: float = declared(
        0.5, "Cell size of the map of the lowest points", 0.1, 10, tuned=(0.3, 1.0)
    )
    window_m: float = declared(
        8.0, "Size of the windows in which ground is plane; smaller ones follow hills", 1, 50
    )
    margin_m: float = declared(
        0.2, "Points lower than this above the planes are ground", 0.01, 2, tuned=(0.1, 0.4)
    )


@dataclass(frozen=True)
class EgoMotionSettings:
    """Ego motion: its estimation, and its removal for networks."""

    removed: bool = declared(
        False, "Remove the ego motion before networks are fitted; online and live mnsf always do"
    )
    source: str = declared(
        "registration",
        "registration: align with a local map; odometry, tf (node only): of the robot where known",
        choices=("registration", "odometry", "tf"),
    )
    sensor_pose: str = declared(
        "parameters",
        "Pose of the lidar in the odometry's child frame: by sensor_x_m to sensor_yaw_deg, or tf",
        choices=("parameters", "tf"),
    )
    deskew: bool = declared(
        True, "Motion compensation to the middle of the sweep; disable for compensated clouds"
    )
    imu: bool = declared(
        True, "Use the turn rates of an IMU, as long as they fit registered rotations"
    )
    max_range_m: float = declared(80.0, "Maximum range of points used for registration", 1, 1000)
    max_points: int = declared(
        65_000, "Maximum number of points of a sweep used for registration", 1000, 10_000_000
    )
    thinning_m: float = declared(
        0.3, "Cell size for thinning; 1.7 times that near the ground", 0.05, 5, tuned=(0.15, 0.6)
    )
    map_cell_m: float = declared(1.0, "Cell size of the local map", 0.1, 10, tuned=(0.5, 2.0))
    map_sweeps: int = declared(
        30, "Map cells are deleted when not seen for this many sweeps", 1, 10_000
    )
    max_gap_s: float = declared(
        2.0, "Map, tracks and networks start afresh after a longer gap", 0.01, 60
    )
    sensor_x_m: float = declared(0.0, "Lidar position in the odometry's child frame, x", -100, 100)
    sensor_y_m: float = declared(0.0, "Lidar position in the odometry's child frame, y", -100, 100)
    sensor_z_m: float = declared(0.0, "Lidar position in the odometry's child frame, z", -100, 100)
    sensor_roll_deg: float = declared(0.0, "Lidar roll in the odometry's child frame", -360, 360)
    sensor_pitch_deg: float = declared(0.0, "Lidar pitch in the odometry's child frame", -360, 360)
    sensor_yaw_deg: float = declared(0.0, "Lidar yaw in the odometry's child frame", -360, 360)


@dataclass(frozen=True)
class TfSettings:
    """Frames of the robot, for the ROS node."""

    fixed_frame: str = declared(
        "odom", "Static frame for ego_motion.source: tf. It must be continuous: odom, not map"
    )
    timeout_s: float = declared(
        0.1, "Longest wait of a sweep for its transform; after it the sweep is registered", 0, 1
    )
    broadcast: bool = declared(
        False, "Publish the pose of ~/ego_motion on /tf, too (needs tf2_ros)", fixed=True
    )
    base_frame: str = declared(
        "", "Robot frame to broadcast, such as base_link; empty: that of the clouds", fixed=True
    )


@dataclass(frozen=True)
class LidarsSettings:
    """Several lidars whose clouds are merged, for the ROS node."""

    count: int = declared(
        1, "Number of lidars, on ~/points, ~/points_2 ..., merged into one cloud", 1, 4, fixed=True
    )
    frame: str = declared(
        "base_link",
        "Level frame fixed to the lidars, such as base_link; of merged clouds",
        fixed=True,
    )
    poses: str = declared(
        "tf",
        "Poses of the lidars in that frame: by tf, or by lidar_1.x_m to lidar_4.yaw_deg; of one "
        "lidar by either, else estimated from the ground",
        choices=("tf", "parameters"),
        fixed=True,
    )
    tolerance_s: float = declared(
        0.06, "Largest difference of the stamps of clouds that are merged", 0, 1
    )
    max_wait_s: float = declared(
        0.2, "Longest wait for another lidar, more than a revolution; then it is left out", 0.01, 1
    )


@dataclass(frozen=True)
class LidarSettings:
    """Pose of a lidar; of several with lidars.poses: parameters, of one if it is not zero."""

    x_m: float = declared(0.0, "Position of this lidar in lidars.frame, x", -100, 100)
    y_m: float = declared(0.0, "Position of this lidar in lidars.frame, y", -100, 100)
    z_m: float = declared(0.0, "Position of this lidar in lidars.frame, z", -100, 100)
    roll_deg: float = declared(0.0, "Roll of this lidar in lidars.frame", -360, 360)
    pitch_deg: float = declared(0.0, "Pitch of this lidar in lidars.frame", -360, 360)
    yaw_deg: float = declared(0.0, "Yaw of this lidar in lidars.frame", -360, 360)


@dataclass(frozen=True)
class ObjectSettings:
    """Grouping of points into objects, and the decision for dynamic (method `online`)."""

    cell_size_m: float = declared(
        0.15, "Cell size for grouping: touching cells form one object", 0.05, 5, tuned=(0.08, 0.35)
    )
    thinning_m: float = declared(
        0.1, "Cell size for thinning before objects are compared", 0.02, 1, tuned=(0.05, 0.2)
    )
    max_points: int = declared(
        60_000, "Maximum number of points of a sweep that are compared", 1000, 10_000_000
    )
    min_points: int = declared(
        5, "Objects with fewer thinned points count as static", 3, 1000, tuned=(3, 15)
    )
    max_size_m: float = declared(
        24.0, "Longer objects count as static (walls, hedges, terrain)", 1, 100, tuned=(12, 40)
    )
    max_height_m: float = declared(
        4.5,
        "Points above the lidar and higher above ground count as static (ceilings, crowns)",
        0.5,
        100,
    )
    points_per_object: int = declared(
        48, "Maximum number of points of an object used to fit its motion", 8, 1000
    )
    max_suspects: int = declared(
        300, "Maximum number of objects whose motion is searched for: moving, nearest", 1, 100_000
    )
    max_speed_m_s: float = declared(36.0, "Maximum speed of objects over ground", 1, 100)
    min_probability: float = declared(
        0.5,
        "Minimum probability of motion. Higher: fewer false positives, more missed movers",
        0.01,
        0.99,
        tuned=(0.1, 0.9),
    )


@dataclass(frozen=True)
class BufferSettings:
    """Limits of the intervals between sweeps."""

    min_interval_s: float = declared(
        0.001, "A sweep sooner than this after the last one is a duplicate", 0.000001, 1
    )
    max_interval_s: float = declared(
        0.5, "After a longer gap, the buffer is cleared and the next estimate starts cold", 0.01, 60
    )


@dataclass(frozen=True)
class DistanceSettings:
    """The distance from a moved point to the target sweep: D in the paper."""

    kind: str = declared(
        "tree",
        "grid: distance transform, as in the paper; bricks: the same up to distance.truncation_m, "
        "in less time; cells: exact up to it, for few lookups (on CUDA bricks); tree: exact",
        choices=("grid", "bricks", "cells", "tree"),
    )
    cell_size_m: float = declared(0.1, "Cell size of the distance transform", 0.01, 10)
    max_cells: int = declared(
        250_000_000,
        "Maximum cells, 4 bytes each in a grid, 2 in bricks. Beyond, bricks replace a truncated "
        "grid, and the tree anything else",
        1000,
        2_000_000_000,
    )
    truncation_m: float = declared(
        2.0, "Larger distances count as this value, against outliers; 0: unlimited", 0, 1000
    )


@dataclass(frozen=True)
class NsfpSettings:
    """Only for the methods `nsfp` and `nsfp-linear`."""

    truncation_m: float = declared(
        1.41421356, "Ignore pairs farther apart (NSFP's code: squared distance 2)", 0.01, 1000
    )
    learning_rate: float = declared(0.008, "Learning rate of Adam", 1e-7, 1)
    weight_decay: float = declared(0.0, "Weight decay of Adam (the authors' code: 0.0001)", 0, 1)
    patience: int = declared(
        30, "Stop after this many iterations without improvement; 0: never", 0, 100_000
    )
    min_delta_m2: float = declared(
        0.001, "Smallest decrease of the loss that is an improvement (authors: 0.0001)", 0, 10
    )


@dataclass(frozen=True)
class LiveSettings:
    """The method `mnsf` at the rate of the sensor."""

    enabled: bool = declared(
        False,
        "Keep the networks from sweep to sweep and fit them where something may move (preset "
        "mnsf); false: fit all points from scratch (as published: preset paper)",
        fixed=True,
    )
    first_iterations: int = declared(
        40, "Iterations of each network from scratch; then optimization.max_iterations", 1, 100_000
    )
    num_octaves: int = declared(
        7, "Wavelengths of encoded positions: 2 m, 4 m, 8 m ...; 0: not encoded", 0, 12
    )


@dataclass(frozen=True)
class MnsfCycleSettings:
    """Only for the method `mnsf-cycle`."""

    weight: float = declared(
        0.1, "Weight of the cycle loss (not given in the paper; NSFP uses 1)", 0, 1000
    )


@dataclass(frozen=True)
class LinearSettings:
    """Only for the methods `nsfp-linear` and `fnsf-linear`."""

    node_spacing_m: float = declared(2.0, "Distance between the nodes of the grid", 0.1, 100)
    sigma_m: float = declared(
        5.0, "Standard deviation of the Gaussian encoding along each axis", 0.1, 100
    )
    variation_weight: float = declared(
        0.5, "Weight of the total variation of the flow between nodes", 0, 1000
    )
    learning_rate: float = declared(0.03, "Learning rate of Adam", 1e-7, 1)


@dataclass(frozen=True)
class FieldSettings:
    """The networks of the forward and the backward field."""

    num_hidden_layers: int = declared(8, "Number of hidden layers, each with a ReLU", 1, 32)
    hidden_width: int = declared(64, "Neurons per hidden layer", 1, 1024)


@dataclass(frozen=True)
class OptimizationSettings:
    """Fit of a field to a pair of sweeps, by Adam."""

    learning_rate: float = declared(0.008, "Learning rate of Adam", 1e-7, 1)
    decay: bool = declared(True, "Let the learning rate decay to zero along a cosine")
    joint: bool = declared(
        False, "Fit both fields together, until the forward loss stops falling (authors' code)"
    )
    max_iterations: int = declared(150, "Maximum number of iterations per field", 1, 100_000)
    max_points: int = declared(
        0, "Fit to this many random points of the cropped sweep; 0: all", 0, 10_000_000
    )
    time_budget_ms: float = declared(
        3000.0, "Time limit of the optimization; 0: none", 0, 3_600_000
    )


@dataclass(frozen=True)
class EarlyStoppingSettings:
    """Convergence of a fit."""

    patience: int = declared(
        0, "Stop a field after this many iterations without improvement; 0: never", 0, 100_000
    )
    min_delta_m: float = declared(
        0.001, "Smallest decrease of the loss that counts as improvement", 0, 10
    )


@dataclass(frozen=True)
class FusionSettings:
    """Fusion of forward flow f and inverted backward flow f'."""

    kind: str = declared(
        "mlp",
        "mlp: a network, as in the paper; weighted_sum: W f + (I - W) f'; mean: (f + f') / 2",
        choices=("mlp", "weighted_sum", "mean"),
    )
    input: str = declared(
        "concat",
        "Input of the mlp. concat: flows side by side, as in the paper; sum: the authors' code",
        choices=("concat", "sum"),
    )
    fields: str = declared(
        "best",
        "Weights of the fused fields. best: lowest loss; last: last iteration (authors' code)",
        choices=("best", "last"),
    )
    inversion: bool = declared(
        True, "Invert the backward flow before fusion; false: only for the ablation of the paper"
    )
    num_hidden_layers: int = declared(3, "Number of hidden layers of the fusion network", 1, 32)
    hidden_width: int = declared(64, "Neurons per hidden layer", 1, 1024)
    max_iterations: int = declared(100, "Maximum number of iterations", 1, 100_000)
    patience: int = declared(
        0, "Stop after this many iterations without improvement; 0: never", 0, 100_000
    )


@dataclass(frozen=True)
class WarmStartSettings:
    """Start from the last estimate, with the methods `online` and `mnsf` (preset `mnsf`)."""

    enabled: bool = declared(
        True, "Start from the motions of the last estimate; false: from scratch"
    )


@dataclass(frozen=True)
class ComputeSettings:
    """Device, precision, threads and random seed."""

    device: str = declared(
        "auto",
        "Device of the networks. auto: CUDA if available, else the CPU",
        choices=("auto", "cpu", "cuda"),
    )
    precision: str = declared(
        "float32",
        "Precision between hidden layers. bfloat16: only where the processor computes in it",
        choices=("float32", "bfloat16"),
    )
    num_threads: int = declared(
        0, "CPU threads. 0: in the node cores less one, in mnsf evaluate 1, else PyTorch's", 0, 512
    )
    cuda_graphs: bool = declared(
        True, "On CUDA, record the steps of a fit once and replay them; false: one call each"
    )
    adapt: bool = declared(
        True,
        "In the node, where sweeps are dropped for lack of time, do less for each: without older "
        "sweeps, then with half and a quarter of objects.max_suspects; all again when that is over",
    )
    seed: int = declared(0, "Seed of initial weights and random points", 0, 2_147_483_647)


@dataclass(frozen=True)
class OutputSettings:
    """Fields of the clouds of the node."""

    layout: str = declared(
        "full",
        "Fields of the clouds. full: all; compact: x, y, z, flow and dynamic, for slow links",
        choices=("full", "compact"),
    )
    rgb: bool = declared(
        True, "Add the field rgb: colour by direction and speed, for RViz and Foxglove"
    )
    deskew_movers: bool = declared(
        False, "In ~/flow/moving, shift each point to where it was at the stamp, by its velocity"
    )
    horizon_s: float = declared(
        2.0, "~/predicted has the ground that dynamic objects will cover in this time", 0, 10
    )


@dataclass(frozen=True)
class NodeSettings:
    """Only for the ROS node."""

    always_estimate: bool = declared(False, "Estimate even if nobody subscribes to any output")
    input_reliability: str = declared(
        "auto",
        "Reliability of the input. auto: reliable if every publisher offers it, else best effort",
        choices=("auto", "reliable", "best_effort"),
        fixed=True,
    )
    diagnostics_period_s: float = declared(
        1.0, "Period of messages on /diagnostics", 0.05, 60, fixed=True
    )
    stale_after_s: float = declared(
        2.0,
        "Report silence after this time without a sweep, or without flow from sweeps",
        0.1,
        3600,
    )
    max_latency_ms: float = declared(
        # Someone on foot goes on by their own size.
        500.0,
        "Warn if the 95th percentile of the latency is above this; 0: no limit",
        0,
        3_600_000,
    )
    max_failures: int = declared(
        3, "Report an error if more estimates than this fail in a row", 0, 1000
    )
    odom_frame: str = declared(
        "scene_flow_odom", "Frame of ~/ego_motion: the sensor frame of the first sweep", fixed=True
    )


@dataclass(frozen=True)
class Settings:
    """All settings. Immutable: a change makes a new object, see `changed`.

    Attributes:
        explicit: Full names of the settings that were set on top of a preset, to whatever value.
            Not compared: settings with the same values are equal. Stored with the settings, for
            `presets.settings_for`.
    """

    method: MethodSettings = MethodSettings()
    time: TimeSettings = TimeSettings()
    crop: CropSettings = CropSettings()
    ground: GroundSettings = GroundSettings()
    buffer: BufferSettings = BufferSettings()
    ego_motion: EgoMotionSettings = EgoMotionSettings()
    tf: TfSettings = TfSettings()
    lidars: LidarsSettings = LidarsSettings()
    lidar_1: LidarSettings = LidarSettings()
    lidar_2: LidarSettings = LidarSettings()
    lidar_3: LidarSettings = LidarSettings()
    lidar_4: LidarSettings = LidarSettings()
    objects: ObjectSettings = ObjectSettings()
    distance: DistanceSettings = DistanceSettings()
    nsfp: NsfpSettings = NsfpSettings()
    live: LiveSettings = LiveSettings()
    mnsf_cycle: MnsfCycleSettings = MnsfCycleSettings()
    linear: LinearSettings = LinearSettings()
    field: FieldSettings = FieldSettings()
    optimization: OptimizationSettings = OptimizationSettings()
    early_stopping: EarlyStoppingSettings = EarlyStoppingSettings()
    fusion: FusionSettings = FusionSettings()
    warm_start: WarmStartSettings = WarmStartSettings()
    compute: ComputeSettings = ComputeSettings()
    output: OutputSettings = OutputSettings()
    node: NodeSettings = NodeSettings()
    explicit: frozenset[str] = dataclasses.field(default=frozenset(), compare=False, repr=False)

    @property
    def of_estimates(self) -> "Settings":
        """The settings with defaults for input and output, which estimates do not depend on."""
        default, elsewhere = Settings(), ("time", "buffer", "tf", "lidars", "output", "node")
        groups = (*elsewhere, "lidar_1", "lidar_2", "lidar_3", "lidar_4")
        return dataclasses.replace(self, **{group: getattr(default, group) for group in groups})

    def changed(self, values: Mapping[str, object]) -> "Settings":
        """Returns these settings with the values of some full names (`crop.max_range_m`) replaced.

        Raises:
            SettingsError: For an unknown name, a wrong type, a value out of range, or values
                that contradict each other.
        """
        groups: dict[str, dict[str, SettingValue]] = {}
        for name, value in values.items():
            setting = declared_setting(name)
            group, _, key = name.partition(".")
            groups.setdefault(group, {})[key] = setting.checked(value)
        replaced = {
            group: dataclasses.replace(getattr(self, group), **items)
            for group, items in groups.items()
        }
        explicit = self.explicit.union(values)
        settings = dataclasses.replace(self, explicit=explicit, **replaced)
        settings._check_consistency()
        return settings

    def to_mapping(self) -> dict[str, SettingValue]:
        """Full name to value of every setting, in the order of declaration."""
        return {setting.name: self.value_of(setting.name) for setting in declared_settings()}

    def value_of(self, name: str) -> SettingValue:
        """The value of the setting with this full name."""
        group, _, key = name.partition(".")
        return getattr(getattr(self, group), key)

    @property
    def without_effect(self) -> str:
        """What of the poses of lidars is not used, in a sentence; empty if there is nothing."""
        count = self.lidars.count
        unused = [
            name
            for name, value in self.to_mapping().items()
            if name.startswith("lidar_")
            and value
            and (int(name[len("lidar_")]) > count or (count > 1 and self.lidars.poses == "tf"))
        ]
        if not unused:
            return ""
        used = f"lidars.count is {count} and lidars.poses {self.lidars.poses}"
        return f"{', '.join(unused)} without effect: {used}"

    def _check_consistency(self) -> None:
        for group, low, high in (
            ("crop", "min_range_m", "max_range_m"),
            ("crop", "min_height_m", "max_height_m"),
            ("buffer", "min_interval_s", "max_interval_s"),
        ):
            values = getattr(self, group)
            smaller, larger = getattr(values, low), getattr(values, high)
            if not smaller < larger:
                raise SettingsError(
                    f"{group}.{low}: got {smaller!r}, expected less than {group}.{high}, "
                    f"which is {larger!r}"
                )
        _ = self.crop.own_boxes, self.time.rotation
        kind = self.distance.kind
        if kind in ("bricks", "cells") and not self.distance.truncation_m:
            raise SettingsError(
                f"distance.kind: got {kind!r} with distance.truncation_m 0, expected a truncation: "
                "set one above 0, or use grid or tree"
            )


@cache
def declared_settings() -> tuple[Setting, ...]:
    """The declarations of all settings, in order."""
    groups = {item.name: item.default for item in dataclasses.fields(Settings)}
    return tuple(
        setting
        for name, group in groups.items()
        if dataclasses.is_dataclass(group)
        for setting in settings_of(type(group), f"{name}.")
    )


def declared_setting(name: str) -> Setting:
    """The declaration of one setting.

    Raises:
        SettingsError: If there is none of that name; the text names the nearest ones.
    """
    by_name = {setting.name: setting for setting in declared_settings()}
    if name not in by_name:
        raise SettingsError(f"unknown setting {shortened(name)}{did_you_mean(name, by_name)}")
    return by_name[name]


def parse_assignments(texts: Iterable[str]) -> dict[str, SettingValue]:
    """Returns the settings and values of texts such as `crop.max_range_m=35`.

    Raises:
        SettingsError: A text is no assignment, the setting is unknown, or the value is not of its
            type or outside its range.
    """
    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise SettingsError(f"got {shortened(text)}, expected NAME=VALUE")
        setting = declared_setting(name.strip())
        values[setting.name] = setting.parsed(value.strip())
    return values
