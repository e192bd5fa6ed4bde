"""Every setting of the project, declared once: type, default, unit, range and meaning.

ROS parameters, the YAML files in `config/`, command-line help and the table in
`docs/parameters.md` are all derived from the dataclasses below. A setting's full name is
`group.field`, for example `crop.max_range_m`. The defaults are the `online` preset.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, get_type_hints

from mnsf_ros.errors import SettingsError

SettingValue = bool | int | float | str


@dataclass(frozen=True)
class Setting:
    """The declaration of one setting.

    Attributes:
        name: `group.field`.
        kind: `bool`, `int`, `float` or `str`.
        default: Value of the `online` preset.
        text: One line for people.
        unit: Unit of the value, empty where it has none.
        minimum: Smallest value allowed, numbers only.
        maximum: Largest value allowed, numbers only.
        choices: The words allowed, strings only.
        fixed: True if it cannot change while a node runs.
    """

    name: str
    kind: type
    default: SettingValue
    text: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    fixed: bool = False

    def checked(self, value: object) -> SettingValue:
        """Returns `value` in this setting's type.

        Raises:
            SettingsError: If the type does not fit, or the value is outside the range.
        """
        typed = self._typed(value)
        if self.choices and typed not in self.choices:
            raise SettingsError(f"{self.name}: got {value!r}, expected {self._expected()}")
        if isinstance(typed, (int, float)) and not isinstance(typed, bool):
            too_small = self.minimum is not None and typed < self.minimum
            too_large = self.maximum is not None and typed > self.maximum
            if too_small or too_large or not math.isfinite(typed):
                raise SettingsError(f"{self.name}: got {value!r}, expected {self._expected()}")
        return typed

    def _typed(self, value: object) -> SettingValue:
        # bool is a subclass of int in Python, and `true` for a number is always a mistake.
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if self.kind is float and is_number:
            with suppress(OverflowError):  # a whole number of more than 308 digits
                return float(value)  # type: ignore[arg-type]
        if self.kind is int and isinstance(value, float) and value.is_integer():
            return int(value)
        if type(value) is self.kind:
            return value  # type: ignore[return-value]
        raise SettingsError(f"{self.name}: got {value!r}, expected {self._expected()}")

    def _expected(self) -> str:
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
        return f"{words[self.kind]}{self.range_text(' from {} to {}')}"

    def range_text(self, pattern: str = "{} to {}") -> str:
        """The range as text, empty where there is none."""
        if self.choices:
            return ", ".join(self.choices)
        if self.minimum is None or self.maximum is None:
            return ""
        return pattern.format(_plain(self.minimum), _plain(self.maximum))


def _plain(number: float) -> str:
    return f"{number:g}" if abs(number) < _LARGE else f"{number:.0f}"


_LARGE = 1_000_000


def _setting(
    default: SettingValue,
    text: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    fixed: bool = False,
) -> Any:  # noqa: ANN401 - dataclasses.field is typed like this, too
    return field(
        default=default,
        metadata={
            "text": text,
            "unit": unit,
            "minimum": minimum,
            "maximum": maximum,
            "choices": choices,
            "fixed": fixed,
        },
    )


@dataclass(frozen=True)
class MethodSettings:
    """Which method the node runs."""

    name: str = _setting(
        "online",
        "Method that estimates the flow. online: ego motion and one motion for each object, in "
        "a tenth of a second on a CPU; mnsf: the networks of the paper; or any other method of "
        "docs/evaluation.md or of an installed package",
    )


@dataclass(frozen=True)
class CropSettings:
    """Which points are used to estimate motion. Points outside get a flow too."""

    min_range_m: float = _setting(
        0.5, "Ignore points nearer than this, for example the robot itself", "m", 0, 1000
    )
    max_range_m: float = _setting(
        80.0, "Ignore points farther than this in the horizontal plane", "m", 1, 1000
    )
    min_height_m: float = _setting(
        -20.0, "Ignore points below this height in the sensor frame", "m", -1000, 1000
    )
    max_height_m: float = _setting(
        4.0, "Ignore points above this height in the sensor frame", "m", -1000, 1000
    )


@dataclass(frozen=True)
class GroundSettings:
    """How ground is separated from objects. Ground says nothing about motion."""

    remove: bool = _setting(
        True,
        "Estimate motion without ground points. Disable only for clouds without ground; otherwise "
        "objects merge and dynamic objects are missed",
    )
    cell_size_m: float = _setting(0.5, "Cell of the ground height map", "m", 0.1, 10)
    window_m: float = _setting(
        8.0, "Objects are narrower than this; what is wider is terrain", "m", 1, 50
    )
    max_slope: float = _setting(
        0.25, "Steepest ground that the height map follows, as rise over run", "", 0, 1
    )
    margin_m: float = _setting(
        0.2, "A point less than this above the height map is ground", "m", 0.01, 2
    )


@dataclass(frozen=True)
class EgoMotionSettings:
    """How the ego motion is estimated, and whether networks use it."""

    removed: bool = _setting(
        False,
        "Remove the ego motion before networks are fitted: all sweeps are moved into the frame of "
        "the current one (the method online always does so)",
    )
    source: str = _setting(
        "registration",
        "registration: of each sweep with a map of the last sweeps; odometry: that of the robot, "
        "and registration where it is missing",
        choices=("registration", "odometry"),
    )
    max_range_m: float = _setting(
        80.0, "Maximum range of points used for registration", "m", 1, 1000
    )
    max_points: int = _setting(
        65_000, "Maximum number of points used for registration", "", 1000, 10_000_000
    )
    thinning_m: float = _setting(
        0.5, "Registration uses one point per cell of this size", "m", 0.05, 5
    )
    map_cell_m: float = _setting(1.0, "Cell of the local map", "m", 0.1, 10)
    map_sweeps: int = _setting(
        30, "Number of sweeps after which unseen map cells are dropped", "", 1, 10_000
    )
    max_gap_s: float = _setting(2.0, "After a longer gap the map is restarted", "s", 0.01, 60)
    sensor_x_m: float = _setting(
        0.0, "Position of the lidar in the odometry's moving frame, x", "m", -100, 100
    )
    sensor_y_m: float = _setting(
        0.0, "Position of the lidar in the odometry's moving frame, y", "m", -100, 100
    )
    sensor_z_m: float = _setting(
        0.0, "Position of the lidar in the odometry's moving frame, z", "m", -100, 100
    )
    sensor_roll_deg: float = _setting(
        0.0, "Roll of the lidar in the odometry's moving frame", "degrees", -360, 360
    )
    sensor_pitch_deg: float = _setting(
        0.0, "Pitch of the lidar in the odometry's moving frame", "degrees", -360, 360
    )
    sensor_yaw_deg: float = _setting(
        0.0, "Yaw of the lidar in the odometry's moving frame", "degrees", -360, 360
    )


@dataclass(frozen=True)
class ObjectSettings:
    """How objects are separated, and which of them are dynamic. Only for the method `online`."""

    cell_size_m: float = _setting(
        0.25, "Points in touching cells of this size, seen from above, are one object", "m", 0.05, 5
    )
    thinning_m: float = _setting(
        0.1, "Objects are measured with one point per cell of this size", "m", 0.02, 1
    )
    max_points: int = _setting(
        60_000, "Maximum number of points used to measure objects", "", 1000, 10_000_000
    )
    min_points: int = _setting(6, "Objects with fewer thinned points are static", "", 3, 1000)
    max_size_m: float = _setting(
        12.0, "Longer objects are static (walls, hedges, terrain)", "m", 1, 100
    )
    points_per_object: int = _setting(48, "Number of points that represent an object", "", 8, 1000)
    max_suspects: int = _setting(
        300,
        "Maximum number of objects whose motion is estimated, the nearest first",
        "",
        1,
        100_000,
    )
    max_speed_m_s: float = _setting(36.0, "Maximum speed of an object over ground", "m/s", 1, 100)
    max_iterations: int = _setting(4, "Steps to fit the motion of an object", "", 1, 100)
    max_unexplained: float = _setting(
        0.65,
        "An object is dynamic only if its motion leaves less than this share of the distance to "
        "the neighbouring sweeps; lower: fewer false positives, more missed movers",
        "",
        0.05,
        1,
    )


@dataclass(frozen=True)
class BufferSettings:
    """Which sweeps may be neighbours in a triplet."""

    min_interval_s: float = _setting(
        0.001, "A sweep less than this after the last one is a duplicate", "s", 0.000001, 1
    )
    max_interval_s: float = _setting(
        0.5, "After a longer gap the buffer is restarted, with a cold start", "s", 0.01, 60
    )


@dataclass(frozen=True)
class DistanceSettings:
    """How far a moved point is from the target sweep: D in the paper."""

    kind: str = _setting(
        "tree",
        "grid: distance transform as in the paper; tree: exact nearest neighbour, cheaper on a CPU "
        "for few points",
        choices=("grid", "tree"),
    )
    cell_size_m: float = _setting(0.1, "Cell of the distance transform", "m", 0.01, 10)
    max_cells: int = _setting(
        250_000_000,
        "A sweep whose grid would have more cells (4 bytes each) uses the tree instead",
        "",
        1000,
        2_000_000_000,
    )
    truncation_m: float = _setting(
        2.0, "Distances beyond this count as this and have no gradient; 0: never", "m", 0, 1000
    )


@dataclass(frozen=True)
class NsfpSettings:
    """What only the methods NSFP and NSFP (linear) of the evaluator need."""

    truncation_m: float = _setting(
        1.41421356,
        "Pairs of points farther apart do not count in the Chamfer distance; NSFP's code compares "
        "squared distances with 2",
        "m",
        0.01,
        1000,
    )
    learning_rate: float = _setting(0.008, "Step size of Adam", "", 1e-7, 1)
    weight_decay: float = _setting(
        0.0, "Pull of Adam on the weights toward zero (the authors' code: 0.0001)", "", 0, 1
    )
    patience: int = _setting(
        30, "Stop after this many steps without improvement; 0: never", "", 0, 100_000
    )
    min_delta_m2: float = _setting(
        0.001,
        "Smaller decreases of the loss do not count as improvement (the authors' code: 0.0001)",
        "m²",
        0,
        10,
    )


@dataclass(frozen=True)
class MnsfCycleSettings:
    """What only the method MNSF (cycle consistency) of the evaluator needs."""

    weight: float = _setting(
        0.1,
        "Weight of the cycle term beside the distance (not given in the paper; NSFP has 1)",
        "",
        0,
        1000,
    )


@dataclass(frozen=True)
class LinearSettings:
    """The fields of the methods NSFP (linear) and FNSF (linear) of the evaluator."""

    node_spacing_m: float = _setting(2.0, "Distance between the nodes of the grid", "m", 0.1, 100)
    sigma_m: float = _setting(5.0, "Width of the Gaussian codes along each axis", "m", 0.1, 100)
    variation_weight: float = _setting(
        0.5, "Weight of the total variation of the flow between nodes", "", 0, 1000
    )
    learning_rate: float = _setting(0.03, "Step size of Adam", "", 1e-7, 1)


@dataclass(frozen=True)
class FieldSettings:
    """What the forward and the backward field are made of."""

    num_hidden_layers: int = _setting(
        8, "Hidden layers, each followed by a ReLU; one output layer comes on top", "", 1, 64
    )
    hidden_width: int = _setting(64, "Neurons of a hidden layer", "", 1, 4096)


@dataclass(frozen=True)
class OptimizationSettings:
    """The Adam loop that fits a field to a pair of sweeps."""

    learning_rate: float = _setting(0.008, "Step size of Adam", "", 1e-7, 1)
    decay: bool = _setting(True, "Let the step size fall to zero along a cosine")
    joint: bool = _setting(
        False,
        "Fit forward and backward field together, from the same start weights, while the "
        "forward loss falls (the authors' code), instead of each by itself (the paper)",
    )
    max_iterations: int = _setting(150, "Steps of a cold start, per field", "", 1, 100_000)
    max_points: int = _setting(
        0, "Fit to this many random points of the cropped sweep; 0: to all", "", 0, 10_000_000
    )
    batch_points: int = _setting(
        1024,
        "Points of a random batch, drawn anew for each step; 0: all in each",
        "",
        0,
        10_000_000,
    )
    time_budget_ms: float = _setting(
        3000.0, "Stop optimizing a cold start after this time; 0: never", "ms", 0, 3_600_000
    )


@dataclass(frozen=True)
class EarlyStoppingSettings:
    """When a fit counts as converged."""

    patience: int = _setting(
        0, "Stop a field after this many steps without improvement; 0: never", "", 0, 100_000
    )
    min_delta_m: float = _setting(
        0.001, "Smaller decreases of the loss do not count as improvement", "m", 0, 10
    )


@dataclass(frozen=True)
class FusionSettings:
    """How forward flow and inverted backward flow become one."""

    kind: str = _setting(
        "mlp",
        "mlp: a network, as the paper; weighted_sum: W f + (I - W) f'; mean: (f + f') / 2",
        choices=("mlp", "weighted_sum", "mean"),
    )
    input: str = _setting(
        "concat",
        "concat: mlp sees all flows side by side, as the paper; sum: their sum (the authors' code)",
        choices=("concat", "sum"),
    )
    fields: str = _setting(
        "best",
        "Weights of the fields whose flow is fused. best: of the lowest loss; last: of the last "
        "step (the authors' code)",
        choices=("best", "last"),
    )
    inversion: bool = _setting(
        True, "Turn the backward flow round before fusion; false only to see what that is worth"
    )
    num_hidden_layers: int = _setting(3, "Hidden layers of the fusion network", "", 1, 64)
    hidden_width: int = _setting(64, "Neurons of a hidden layer", "", 1, 4096)
    max_iterations: int = _setting(100, "Steps of a cold start", "", 1, 100_000)
    patience: int = _setting(
        0, "Stop after this many steps without improvement; 0: never", "", 0, 100_000
    )


@dataclass(frozen=True)
class WarmStartSettings:
    """What one triplet hands to the next: fields, fusion and the state of their optimizers."""

    enabled: bool = _setting(True, "Start from the motions or the networks of the last triplet")
    max_iterations: int = _setting(30, "Steps per network after a warm start", "", 1, 100_000)
    learning_rate: float = _setting(0.002, "Step size of Adam after a warm start", "", 1e-7, 1)
    time_budget_ms: float = _setting(
        800.0, "Stop optimizing a warm start after this time; 0: never", "ms", 0, 3_600_000
    )
    max_gap_s: float = _setting(
        10.0, "Start cold if the last triplet is older than this", "s", 0.01, 3600
    )
    max_loss_ratio: float = _setting(
        2.0, "Start cold if the loss of the carried field has grown by more than this", "", 1, 1000
    )


@dataclass(frozen=True)
class ComputeSettings:
    """Where and how reproducibly the work is done."""

    device: str = _setting(
        "auto", "auto takes CUDA where there is one", choices=("auto", "cpu", "cuda")
    )
    num_threads: int = _setting(
        0,
        "Threads of torch; 0: in the node one per core less one, elsewhere torch's own",
        "",
        0,
        512,
    )
    seed: int = _setting(0, "Seed of start weights and random batches", "", 0, 2_147_483_647)


@dataclass(frozen=True)
class NodeSettings:
    """What only the ROS node needs."""

    always_estimate: bool = _setting(False, "Estimate even while nobody subscribes to any output")
    input_reliability: str = _setting(
        "auto",
        "auto takes reliable where every publisher offers it",
        choices=("auto", "reliable", "best_effort"),
        fixed=True,
    )
    diagnostics_period_s: float = _setting(
        1.0, "Time between two messages on /diagnostics", "s", 0.05, 60, fixed=True
    )
    stale_after_s: float = _setting(
        2.0, "Report the input as stale after this time without a sweep", "s", 0.1, 3600
    )


@dataclass(frozen=True)
class Settings:
    """All settings. Immutable: a change makes a new object, see `changed`."""

    method: MethodSettings = MethodSettings()
    crop: CropSettings = CropSettings()
    ground: GroundSettings = GroundSettings()
    buffer: BufferSettings = BufferSettings()
    ego_motion: EgoMotionSettings = EgoMotionSettings()
    objects: ObjectSettings = ObjectSettings()
    distance: DistanceSettings = DistanceSettings()
    nsfp: NsfpSettings = NsfpSettings()
    mnsf_cycle: MnsfCycleSettings = MnsfCycleSettings()
    linear: LinearSettings = LinearSettings()
    field: FieldSettings = FieldSettings()
    optimization: OptimizationSettings = OptimizationSettings()
    early_stopping: EarlyStoppingSettings = EarlyStoppingSettings()
    fusion: FusionSettings = FusionSettings()
    warm_start: WarmStartSettings = WarmStartSettings()
    compute: ComputeSettings = ComputeSettings()
    node: NodeSettings = NodeSettings()

    def changed(self, values: Mapping[str, object]) -> Settings:
        """Returns these settings with some values replaced.

        Args:
            values: Full names (`crop.max_range_m`) to new values.

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
        settings = dataclasses.replace(self, **replaced)
        settings._check_consistency()
        return settings

    def to_mapping(self) -> dict[str, SettingValue]:
        """Full name to value of every setting, in the order of declaration."""
        return {setting.name: self.value_of(setting.name) for setting in declared_settings()}

    def value_of(self, name: str) -> SettingValue:
        """The value of the setting with this full name."""
        group, _, key = name.partition(".")
        value: SettingValue = getattr(getattr(self, group), key)
        return value

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


@cache
def declared_settings() -> tuple[Setting, ...]:
    """The declarations of all settings, in order."""
    return tuple(_declarations())


def declared_setting(name: str) -> Setting:
    """The declaration of one setting.

    Raises:
        SettingsError: If there is none of that name; the text names the nearest ones.
    """
    import difflib

    by_name = {setting.name: setting for setting in declared_settings()}
    if name in REPLACED:
        raise SettingsError(f"unknown setting {name!r}: {REPLACED[name]}")
    if name not in by_name:
        near = difflib.get_close_matches(name, by_name, n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise SettingsError(f"unknown setting {name!r}{hint}")
    return by_name[name]


# Settings of earlier versions, and what to do instead.
REPLACED = {
    "field.kind": "set method.name instead, to online (it was objects) or to mnsf (it was network)"
}


def _declarations() -> Iterator[Setting]:
    defaults = Settings()
    for group in dataclasses.fields(Settings):
        values = getattr(defaults, group.name)
        kinds = get_type_hints(type(values))
        for item in dataclasses.fields(values):
            yield Setting(
                name=f"{group.name}.{item.name}",
                kind=kinds[item.name],
                default=getattr(values, item.name),
                **item.metadata,
            )
