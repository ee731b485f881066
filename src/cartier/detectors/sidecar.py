"""The sidecar ``MODEL.json``: what an ONNX file does not say about itself. Its keys and their defaults stand here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from cartier.errors import InputError, brief
from cartier.io.files import read_bytes
from cartier.labels import MAX_NAME_CHARS, display_name
from cartier.types import DetectorScoreModel

MAX_BYTES = 4 * 2**20
COCO80 = Path(__file__).parent / "labels" / "coco80.txt"
COCO_GAPS = (0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83)  # category ids below 91 that COCO never filled

AsList = Field(strict=False)  # JSON has lists, not tuples; what is in them stays strict
Three = Annotated[tuple[float, float, float], AsList]
Side = Annotated[int, Field(ge=1, le=8192)]
PLAIN: dict[str, Any] = {"mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0)}
IMAGENET: dict[str, Any] = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}
DEFAULTS: dict[str, dict[str, Any]] = {
    "fastestdet": PLAIN | {"channels": "bgr", "scale": 255.0, "resize": "stretch", "threshold": 0.5},
    "yolov8": PLAIN | {"channels": "rgb", "scale": 255.0, "resize": "letterbox", "threshold": 0.5},
    "yolox": PLAIN | {"channels": "bgr", "scale": 1.0, "resize": "letterbox_top_left", "threshold": 0.5},
    "nanodet": {"channels": "bgr", "scale": 1.0, "mean": (103.53, 116.28, 123.675), "std": (57.375, 57.12, 58.395)}
    | {"resize": "stretch", "threshold": 0.4},
    "detr": IMAGENET | {"channels": "rgb", "scale": 255.0, "resize": "stretch", "threshold": 0.7},
    "end_to_end": PLAIN | {"channels": "rgb", "scale": 255.0, "resize": "letterbox", "threshold": 0.5},
    "exported": PLAIN | {"channels": "rgb", "scale": 255.0, "resize": "stretch", "threshold": 0.5},
}


KEYS_OF = {"activation": ("detr",), "box_units": ("exported",), "more_columns": ("yolov8", "end_to_end")}


class Sidecar(BaseModel):
    """How to feed an ONNX detector and read its outputs. Only ``layout`` and ``labels`` have no default."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    layout: Literal["fastestdet", "yolov8", "yolox", "nanodet", "detr", "end_to_end", "exported"]
    labels: Annotated[tuple[str | None, ...], Field(strict=False, min_length=1, max_length=100_000)]
    """Names in the order of the class numbers; null is a class that means nothing. In JSON also "coco" or "coco91"."""
    input_size: Annotated[tuple[Side, Side], AsList] | None = None
    """(width, height) in pixels; needed only where the ONNX file leaves it open."""
    channels: Literal["rgb", "bgr"]
    scale: Annotated[float, Field(gt=0)]
    mean: Three
    std: Three
    """The network is fed (value / scale - mean) / std, per channel in the order of ``channels``."""
    resize: Literal["stretch", "letterbox", "letterbox_top_left"]
    threshold: Annotated[float, Field(ge=0, le=1)]
    """The score from which a detection counts by itself."""
    score_model: DetectorScoreModel | None = None
    """What its detections are worth, if that was measured: the fields of ``types.DetectorScoreModel``."""
    activation: Literal["softmax", "sigmoid"] = "softmax"
    """Layout detr: softmax over labels and a last "no object", or a sigmoid per label."""
    box_units: Literal["pixels", "normalised"] = "pixels"
    """Layout exported: xyxy boxes in pixels of the input (or of ``orig_target_sizes``), or as fractions of it."""
    more_columns: Annotated[int, Field(ge=0, le=4096)] = 0
    """Layouts yolov8 and end_to_end: columns after the boxes and scores, as masks' and key points', not read."""
    outputs: Annotated[tuple[str, ...], AsList] | None = None
    """Names of the outputs in the layout's order, where the ONNX file calls them otherwise."""

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, given: Any) -> Any:
        layout = given.get("layout") if isinstance(given, dict) else None
        return DEFAULTS[layout] | given if isinstance(layout, str) and layout in DEFAULTS else given

    @model_validator(mode="after")
    def _keys_of_its_layout(self) -> Sidecar:
        for key, layouts in KEYS_OF.items():
            if key in self.model_fields_set and self.layout not in layouts:
                raise ValueError(f"the key {key!r} belongs to the layout {layouts[0]!r}, not to {self.layout!r}")
        return self

    @field_validator("labels", mode="before")
    @classmethod
    def _known_set(cls, labels: Any) -> Any:
        if not isinstance(labels, str):
            return labels
        sets = {"coco": coco80, "coco91": coco91}
        if labels not in sets:
            raise ValueError(f'must be a list of names, or "coco" or "coco91", got {brief(labels, 40)!r}')
        return sets[labels]()

    @field_validator("labels")
    @classmethod
    def _display_names(cls, labels: tuple[str | None, ...]) -> tuple[str | None, ...]:
        if any(label is not None and len(label) > MAX_NAME_CHARS for label in labels):
            raise ValueError(f"a label has {MAX_NAME_CHARS} characters at most")
        names = tuple(None if label is None else display_name(label) for label in labels)
        if "" in names:
            raise ValueError(f"label {names.index('')} is empty; a class that means nothing is null")
        return names

    @field_validator("score_model", mode="before")
    @classmethod
    def _score_model(cls, given: Any) -> Any:
        try:
            return DetectorScoreModel.from_dict(given) if isinstance(given, dict) else given
        except TypeError as error:
            raise ValueError(f"must hold the fields of a score_model ({error})") from error

    @field_validator("std")
    @classmethod
    def _positive(cls, std: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(std) <= 0:
            raise ValueError(f"must be positive, got {list(std)}")
        return std


def coco80() -> tuple[str | None, ...]:
    """The 80 COCO names in the order that most detectors number them."""
    return tuple(COCO80.read_text(encoding="utf-8").split("\n")[:-1])


def coco91() -> tuple[str | None, ...]:
    """The same names at COCO's own category ids 1 to 90, as DETR and torchvision number them; None in the gaps."""
    names = iter(coco80())
    return tuple(None if i in COCO_GAPS else next(names) for i in range(91))


def read_sidecar(path: Path) -> Sidecar:
    """The sidecar in a JSON file, or an InputError that names the key that is wrong."""
    try:
        return Sidecar.model_validate_json(read_bytes(path, MAX_BYTES))
    except ValidationError as error:
        raise InputError(f"{path}: {_first_fault(error)}") from error


def sidecar_of(path: Path, keys: dict[str, Any]) -> Sidecar:
    """A sidecar of what an ONNX file says about itself, or an InputError that says which is wrong."""
    try:
        return Sidecar.model_validate(keys)
    except ValidationError as error:
        raise InputError(f"{path}: its metadata: {_first_fault(error)}") from error


def _first_fault(error: ValidationError) -> str:
    fault = error.errors(include_url=False)[0]
    key = brief(".".join(str(part) for part in fault["loc"]), 80)
    if fault["type"] == "extra_forbidden":
        return f"there is no key {key!r}; the keys are {', '.join(Sidecar.model_fields)}"
    if fault["type"] == "missing":
        return f"the key {key!r} is missing"
    message = brief(fault["msg"].removeprefix("Value error, "), 160)
    return f"{key}: {message}" if key else message
