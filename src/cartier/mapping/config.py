"""Mapping configuration: the numbers of the mapper that matter, typed, with what each does and where it comes from.

``MappingConfig`` is given to ``map_home`` and ``Mapper``, or written as TOML for ``cartier map --config FILE.toml``:
one table for each part, such as ``[association]`` with ``threshold = 0.7``. What a file leaves out keeps its default.
A home stores only what differs from the defaults.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from cartier.errors import InputError, brief
from cartier.home.entity import Home
from cartier.io.files import read_text

MAX_CONFIG_BYTES = 1 << 20


def bounded(default: float, low: float, high: float) -> Any:
    """A field for a number from ``low`` to ``high``; whole if the default is an int."""
    return field(default=default, metadata={"bounds": (low, high)})


class _Section:
    """A part of the configuration. Raises InputError for a value of another type or out of range."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value, (low, high), default = getattr(self, each.name), each.metadata["bounds"], each.default
            kind, kinds = ("a whole number", (int,)) if isinstance(default, int) else ("a number", (int, float))
            if type(value) not in kinds or not (math.isfinite(value) and low <= value <= high):
                where = f"{type(self).__name__.removesuffix('Config').lower()}.{each.name}"
                raise InputError(f"{where} must be {kind} from {low:g} to {high:g}, got {brief(value, 40)}")
            object.__setattr__(
                self, each.name, value if isinstance(default, int) else float(value)
            )  # 1 and 1.0 give one home id


@dataclass(frozen=True)
class AssociationConfig(_Section):
    """Which detection is of which object."""

    threshold: float = bounded(0.6, 0.0, 1.35)
    """Least score of a pair, with depth. More: fewer wrong matches, more objects stand in the map twice. By hand."""
    bearing_threshold: float = bounded(0.4, 0.0, 1.0)
    """The same without depth, where a score is a likelihood. By hand."""
    label_weight: float = bounded(0.35, 0.0, 1.0)
    """What an equal label adds to a score. More: wrong labels split objects, neighbours are confused less. By hand."""
    duplicate_iou: float = bounded(0.7, 0.0, 1.0)
    """Overlap in the image from which boxes of any labels are of one object. More: more duplicates stay. By hand."""


@dataclass(frozen=True)
class ExistenceConfig(_Section):
    """How likely it is that an object exists."""

    confirmed_probability: float = bounded(0.7, 0.0, 1.0)
    """Probability from which an object is listed. More: fewer false positives, more objects missed. By hand."""
    min_in_view_share: float = bounded(0.7, 0.0, 1.0)
    """Share of the surface in the image from which a frame is observable. More: less evidence at its edges. By hand."""
    min_visible_share: float = bounded(0.5, 0.0, 1.0)
    """Share of the surface that depth must show in place. More: less evidence against what is half hidden. By hand."""
    min_angle_rad: float = bounded(0.03, 0.0, 1.0)
    """What appears smaller is not observable. More: less evidence against small and far objects. By hand."""
    near_range_m: float = bounded(1.2, 0.1, 20.0)
    """Where the near viewpoint bins end. More: fewer bins count as other viewpoints. By hand."""
    far_range_m: float = bounded(2.4, 0.1, 20.0)
    """Where the far viewpoint bins begin. More: fewer bins count as other viewpoints. By hand."""


@dataclass(frozen=True)
class ExtentConfig(_Section):
    """How the extent of an object follows its views, and how its box is fitted to the best of them."""

    grow_rate: float = bounded(0.5, 0.0, 1.0)
    """Share of the way that a side moves outwards to a view. More: sooner at full size, and at noise. By hand."""
    shrink_rate: float = bounded(0.05, 0.0, 1.0)
    """Share of the way that a side moves inwards. More: partial views make objects too small. By hand."""
    min_agreement: float = bounded(0.9, 0.0, 1.0)
    """Share of the views of a point that must have it in their box. More: boxes hold less background, and may lose
    edges. Eight generated homes."""


@dataclass(frozen=True)
class MergingConfig(_Section):
    """Which objects turn out to be one, and which are forgotten."""

    interval_frames: int = bounded(10, 1, 10_000)
    """Frames between two passes. More: less work, and duplicates live longer. By hand."""
    max_covisible_share: float = bounded(0.3, 0.0, 1.0)
    """Objects seen side by side in a larger share of their detections stay two. More: more merging. By hand."""
    same_label_iou: float = bounded(0.3, 0.0, 1.0)
    """Overlap in space from which two objects of one label are one. More: less merging. By hand."""
    fitted_overlap: float = bounded(0.3, 0.0, 1.0)
    """Share of the smaller fitted box within the other from which two objects of one label are one. More: less merging.
    Eight generated homes."""
    other_label_iou: float = bounded(0.55, 0.0, 1.0)
    """The same for two objects of different labels. More: less merging. By hand."""
    max_fragment_ratio: float = bounded(1.1, 0.0, 10.0)
    """Two fragments whose union is at most so many usual sizes of the label are one. More: more merging. By hand."""
    prune_max_detected: int = bounded(2, 0, 10_000)
    """Objects detected at most so often are pruned. More: fewer false positives, more rare objects lost. By hand."""
    prune_min_observable: int = bounded(30, 1, 10_000)
    """But not before so many observable frames. More: false positives stay longer. By hand."""


@dataclass(frozen=True)
class KeyframesConfig(_Section):
    """Which frames the detector sees."""

    distance_m: float = bounded(0.15, 0.001, 10.0)
    """Way of the camera to the next keyframe. More: fewer detections, faster. By hand: five sixths of a view overlap.
    """
    angle_deg: float = bounded(10.0, 0.1, 180.0)
    """Turn of the camera to the next keyframe. More: fewer detections, faster. By hand, as the distance."""


@dataclass(frozen=True)
class OccupancyConfig(_Section):
    """The floor plan."""

    resolution_m: float = bounded(0.05, 0.01, 1.0)
    """Side of a cell. More: faster and coarser; narrow passages close. The usual value of Nav2."""
    robot_radius_m: float = bounded(0.2, 0.01, 5.0)
    """Discs of this radius along the way of the camera are free. More: more free floor. Half a person's width."""
    floor_m: float = bounded(0.10, 0.01, 0.5)
    """Points up to this height are floor. More: tolerates noise and tilt, misses low obstacles. Depth noise at 4 m."""
    band_top_m: float = bounded(1.5, 0.1, 5.0)
    """What hangs higher is no obstacle. More: tables under lamps and open doors may block. Above a usual robot."""
    range_m: float = bounded(5.0, 0.5, 100.0)
    """Depth beyond this is not used. More: larger plans from few frames, more noise. Range of usual depth cameras."""
    min_points: int = bounded(2, 1, 1000)
    """Points in a cell and frame that count. More: fewer flying pixels, small obstacles missed. By hand."""
    free_beats_occupied: int = bounded(4, 1, 1000)
    """Frames that show floor, per frame with an obstacle, that free a cell. More: moved furniture stays. By hand."""


@dataclass(frozen=True)
class RoomsConfig(_Section):
    """How the floor plan is cut into rooms."""

    door_width_m: float = bounded(1.1, 0.1, 5.0)
    """A narrower passage parts two rooms. More: more and smaller rooms. Standard doors are at most 1 m wide."""
    min_area_m2: float = bounded(1.0, 0.0, 100.0)
    """A smaller room is a corner of its neighbour. More: fewer rooms. By hand."""
    min_wall_height_m: float = bounded(1.2, 0.1, 5.0)
    """What is lower parts no rooms. More: less furniture is taken for a wall. By hand."""


@dataclass(frozen=True)
class MappingConfig:
    """The numbers of mapping that can be set; the fields of each section say what they do.

    Args:
        association: Which detection is of which object.
        existence: How likely it is that an object exists.
        extent: How the box of an object follows its views.
        merging: Which objects turn out to be one, and which are pruned.
        keyframes: Which frames the detector sees.
        occupancy: The floor plan.
        rooms: How the floor plan is cut into rooms.

    Raises:
        InputError: A value is of another type, or out of range.
    """

    association: AssociationConfig = field(default_factory=AssociationConfig)
    existence: ExistenceConfig = field(default_factory=ExistenceConfig)
    extent: ExtentConfig = field(default_factory=ExtentConfig)
    merging: MergingConfig = field(default_factory=MergingConfig)
    keyframes: KeyframesConfig = field(default_factory=KeyframesConfig)
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)
    rooms: RoomsConfig = field(default_factory=RoomsConfig)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> MappingConfig:
        """A configuration from nested JSON or TOML values.

        Args:
            values: Sections with their values; what is left out keeps its default.

        Returns:
            The configuration.

        Raises:
            InputError: A key is unknown, or a value is of another type or out of range.
        """
        kinds = {each.name: each.default_factory for each in fields(cls)}
        made = {}
        for section, given in values.items():
            _check_known(section, kinds, "")
            if not isinstance(given, Mapping):
                raise InputError(f"{section} must be a table of numbers, got {brief(given, 40)}")
            kind: Any = kinds[section]
            for name in given:
                _check_known(name, [each.name for each in fields(kind)], f"{section}.")
            made[section] = kind(**given)
        return cls(**made)

    def differences(self, other: MappingConfig | None = None) -> dict[str, dict[str, float]]:
        """The values that differ from another configuration.

        Args:
            other: The other configuration; by default the defaults.

        Returns:
            The values of this one that differ, by section and name.
        """
        base = asdict(DEFAULT_CONFIG if other is None else other)
        changed = {
            section: {name: value for name, value in values.items() if value != base[section][name]}
            for section, values in asdict(self).items()
        }
        return {section: values for section, values in changed.items() if values}


DEFAULT_CONFIG = MappingConfig()


def read_config(path: Path) -> MappingConfig:
    """The configuration in a TOML file. Raises InputError with one line for what is wrong in it."""
    try:
        return MappingConfig.from_dict(tomllib.loads(read_text(path, MAX_CONFIG_BYTES)))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML ({brief(error)})") from error
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error


def config_for(given: MappingConfig | None, onto: Home | None) -> MappingConfig:
    """The configuration given, or that of the home to go on from, from which the given one must not differ."""
    if onto is None:
        return given or DEFAULT_CONFIG
    try:
        stored = MappingConfig.from_dict(onto.settings.get("config", {}))
    except (InputError, AttributeError) as error:
        raise InputError(
            f"{onto.name} keeps no sound configuration to go on from ({brief(error)}): map it again"
        ) from error
    if given is not None and given != stored:
        (section, values), *_ = given.differences(stored).items()
        name, value = next(iter(values.items()))
        kept = getattr(getattr(stored, section), name)
        raise InputError(
            f"{onto.name} was mapped with {section}.{name} = {kept:g}, not {value:g}: leave the configuration out, or "
            "map it again"
        )
    return stored


def _check_known(name: str, known: Mapping[str, Any] | list[str], where: str) -> None:
    if name not in known:
        close = get_close_matches(name, known, 1, cutoff=0)
        raise InputError(f"unknown key {where}{brief(name, 40)}: did you mean {where}{close[0]}?")
