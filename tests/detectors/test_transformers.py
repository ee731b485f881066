"""Every family on random weights: loaded offline, asked with its names encoded once, equal to the stock forward."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_transformers import CLASSES, FAMILIES, NAMES, ZERO_SHOT, save

from cartier import plugins
from cartier.detectors.boxes import iou
from cartier.detectors.transformers import FAMILIES as KNOWN
from cartier.detectors.transformers import TransformersDetector, make
from cartier.errors import BackendError
from cartier.labels import display_name
from cartier.types import Camera, Detections, Frame

torch = pytest.importorskip("torch", reason="needs the extra [detect]: torch")
hf = pytest.importorskip("transformers", reason="needs the extra [detect]: transformers")

Made = Callable[..., TransformersDetector]


def frame(index: int = 0, width: int = 100, height: int = 70) -> Frame:
    rgb = np.random.default_rng(index).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return Frame(index, 0.0, rgb, None, np.eye(4), Camera(width, height, 60.0, 60.0, width / 2, height / 2))


FRAMES = (frame(0), frame(1, 64, 48), frame(2, 33, 97), frame(3), frame(4))


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    root = tmp_path_factory.mktemp("models")
    return cache(lambda family: save(family, root / family))


@pytest.fixture
def made(folder: Callable[[str], Path]) -> Made:
    def build(family: str, **options: Any) -> TransformersDetector:
        words = {"vocabulary": NAMES} if family in ZERO_SHOT else {}
        return make(folder(family), **{"threshold": 0.0, "device": "cpu"} | words | options)

    return build


def pixels_of(detector: TransformersDetector, *frames: Frame) -> dict[str, Any]:
    images = [view.rgb for view in frames]
    return dict(detector._loaded.images(images=images, return_tensors="pt", input_data_format="channels_last"))


def tokens_of(detector: TransformersDetector, texts: list[str]) -> dict[str, Any]:
    tokenizer = detector._loaded.tokenizer
    return dict(tokenizer(texts, padding="max_length", truncation=True, return_tensors="pt"))


def stock_owl(detector: TransformersDetector, pixels: Any, names: list[str]) -> tuple[Any, Any]:
    text = tokens_of(detector, [f"a photo of a {name}" for name in names] * len(pixels["pixel_values"]))
    out = detector._loaded.model(**pixels, input_ids=text["input_ids"], attention_mask=text["attention_mask"])
    return out.logits.sigmoid(), out.pred_boxes


def stock_grounding(detector: TransformersDetector, pixels: Any, names: list[str]) -> tuple[Any, Any]:
    """One stock forward with the prompt that transformers' own processor would make of these names."""
    from transformers.models.grounding_dino.modeling_grounding_dino import build_label_maps

    prompt = ". ".join(names) + "."
    text = detector._loaded.tokenizer([prompt] * len(pixels["pixel_values"]), return_tensors="pt")
    out = detector._loaded.model(**pixels, **text)
    maps = build_label_maps(out.logits, text["input_ids"])[0].float()
    return out.logits.sigmoid() @ (maps / maps.sum(1, keepdim=True)).T, out.pred_boxes


def stock_omdet(detector: TransformersDetector, pixels: Any, names: list[str]) -> tuple[Any, Any]:
    count = len(pixels["pixel_values"])
    text = {"classes": tokens_of(detector, names * count)}
    text["tasks"] = tokens_of(detector, [f"Detect {', '.join(names)}."] * count)
    ids = {f"{part}_{key}": text[part][key] for part in text for key in ("input_ids", "attention_mask")}
    out = detector._loaded.model(
        pixel_values=pixels["pixel_values"], classes_structure=torch.tensor([len(names)] * count), **ids
    )
    return out.decoder_class_logits.sigmoid(), out.decoder_coord_logits


STOCK: dict[str, Callable[..., tuple[Any, Any]]] = {
    "owlv2": stock_owl,
    "owlvit": stock_owl,
    "grounding-dino": stock_grounding,
    "mm-grounding-dino": stock_grounding,
    "omdet-turbo": stock_omdet,
}


def test_every_family_has_its_tiny_model() -> None:
    assert tuple(KNOWN) == tuple(FAMILIES)


@pytest.mark.parametrize("family", ZERO_SHOT)
def test_names_encoded_once_give_what_the_stock_forward_gives(made: Made, family: str) -> None:
    detector = made(family)
    asked: set[int] = set()
    with torch.inference_mode():
        for views in (FRAMES[:1], (FRAMES[0], FRAMES[3], FRAMES[4])):
            pixels = pixels_of(detector, *views)
            passes = list(detector._head.passes(pixels))
            for answer in passes:
                names = [display_name(NAMES[number]) for number in answer.names]
                scores, boxes = STOCK[family](detector, pixels, names)
                assert scores.shape == answer.scores.shape
                assert (scores - answer.scores).abs().max() < 1e-5
                assert (boxes - answer.boxes).abs().max() < 1e-5
                assert scores.std(dim=1).max() > 1e-3, "a network that says the same of everything proves nothing"
                asked |= set(answer.names)
    assert asked == set(range(len(NAMES)))
    assert len(passes) == (2 if "dino" in family else 1)


@pytest.mark.parametrize("family", FAMILIES)
def test_detections_obey_on_frames_of_changing_size(folder: Callable[[str], Path], family: str) -> None:
    words = {"vocabulary": NAMES} if family in ZERO_SHOT else {}
    detector = plugins.make("detectors", "transformers", model=str(folder(family)), threshold=0.01, **words)
    known = {display_name(name) for name in (NAMES if words else CLASSES[1:])}
    for view in FRAMES:
        before = view.rgb.copy()
        found = detector.detect(view)
        assert isinstance(found, Detections)
        assert found.frame == view.index
        assert len(found) > 0
        assert ((found.boxes_xyxy >= 0) & (found.boxes_xyxy <= [view.camera.width, view.camera.height] * 2)).all()
        assert (found.boxes_xyxy[:, 2:] - found.boxes_xyxy[:, :2] >= 1).all()
        assert (found.scores >= detector.score_model.zero_weight_score - 1e-6).all()
        assert (np.diff(found.scores) <= 0).all()
        assert set(found.labels) <= known
        assert np.array_equal(view.rgb, before)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_batch_gives_what_its_frames_give_one_by_one(made: Made, family: str) -> None:
    detector = made(family)
    together = detector.detect_batch(FRAMES)
    for batched, view in zip(together, FRAMES, strict=True):
        alone = detector.detect(view)
        assert batched.frame == view.index
        assert batched.labels == alone.labels
        assert np.allclose(batched.boxes_xyxy, alone.boxes_xyxy, atol=1e-3)
        assert np.allclose(batched.scores, alone.scores, atol=1e-5)
    assert detector.detect_batch([]) == []


@pytest.mark.parametrize("family", ["detr", "yolos", "rt_detr", "rt_detr_v2", "d_fine", "owlv2", "owlvit"])
@pytest.mark.parametrize("view", [FRAMES[0], FRAMES[2]], ids=["wide", "tall"])
def test_boxes_are_where_the_models_own_post_processing_puts_them(made: Made, family: str, view: Frame) -> None:
    """Ours are fewer: one name per query, clipped, without duplicates. Each must be among theirs, with their best."""
    detector = made(family)
    found = detector.detect(view)
    pixels = detector._images([view.rgb])
    with torch.inference_mode():
        if family in ZERO_SHOT:
            scores, boxes = stock_owl(detector, pixels, [display_name(name) for name in NAMES])
            out = type("Out", (), {"logits": scores.logit(), "pred_boxes": boxes})
        else:
            out = detector._loaded.model(**pixels)
    images = detector._loaded.images
    theirs = images.post_process_object_detection(out, 0.0, [(view.camera.height, view.camera.width)])[0]
    boxes = np.clip(theirs["boxes"].numpy(), 0, [view.camera.width, view.camera.height] * 2)
    names = [detector._head.names[number] for number in theirs["labels"]]
    weakest = float(
        theirs["scores"].min()
    )  # RT-DETR's cuts its list: a query's second name may push out another's first
    assert found.scores[0] > weakest or family in ("detr", "yolos")
    for box, score, label in zip(found.boxes_xyxy, found.scores, found.labels, strict=True):
        same = np.isclose(boxes, box, atol=0.01).all(axis=1) & np.isclose(theirs["scores"].numpy(), score, atol=1e-5)
        assert label in [names[i] for i in np.flatnonzero(same)] or score <= weakest
    whole = [i for i in range(len(boxes)) if (boxes[i, 2:] - boxes[i, :2] >= 1).all() and names[i] is not None]
    assert found.scores[0] == pytest.approx(max(float(theirs["scores"][i]) for i in whole), abs=1e-5)


@pytest.mark.parametrize("family", ZERO_SHOT)
def test_text_is_encoded_once_and_each_image_once(made: Made, family: str) -> None:
    calls: list[str] = []

    def counted(module: Any, what: str) -> None:
        forward = module.forward
        module.forward = lambda *inputs, **named: (calls.append(what), forward(*inputs, **named))[1]

    detector = made(family)
    modules = dict(detector._loaded.model.named_modules())
    for what, names in {
        "text": ("owlv2.text_model", "owlvit.text_model", "model.text_backbone", "language_backbone"),
        "image": ("owlv2.vision_model", "owlvit.vision_model", "model.backbone.conv_encoder", "vision_backbone"),
    }.items():
        counted(next(modules[name] for name in names if name in modules), what)
    for view in FRAMES:
        detector.detect(view)
    assert calls.count("text") == (2 if "dino" in family else 0)  # 0: encoded when made; 2: one per prompt
    assert calls.count("image") == len(FRAMES)


@pytest.mark.parametrize("family", ZERO_SHOT)
def test_one_thing_has_one_name(made: Made, family: str) -> None:
    found = made(family).detect(FRAMES[0])
    for i in range(len(found)):
        overlaps = iou(found.boxes_xyxy[i], found.boxes_xyxy[i + 1 :])
        same = np.array([label == found.labels[i] for label in found.labels[i + 1 :]], bool)
        assert (overlaps <= np.where(same, 0.5, 0.8) + 1e-6).all()


@pytest.mark.parametrize("family", ["owlv2", "mm-grounding-dino", "detr"])
def test_a_higher_threshold_gives_fewer_of_the_same(made: Made, family: str) -> None:
    low = made(family).detect(FRAMES[0])
    middle = float(low.scores[len(low) // 2])
    stricter = made(family, threshold=middle)
    high, least = (
        stricter.detect(FRAMES[0]),
        np.float32(stricter.score_model.zero_weight_score),
    )  # from there on a score is evidence
    assert 0 < len(high) <= len(low)
    assert high.labels == low.labels[: len(high)]
    np.testing.assert_allclose(high.scores, low.scores[low.scores >= least][: len(high)], atol=1e-6)


@pytest.mark.parametrize("family", ["detr", "rt_detr"])
def test_a_class_that_means_nothing_is_left_out(made: Made, family: str) -> None:
    detector = made(family)
    assert detector._head.names[0] is None
    best = detector.detect(FRAMES[0]).labels[0]
    detector._head.names[detector._head.names.index(best)] = None
    assert best not in detector.detect(FRAMES[0]).labels


@pytest.mark.parametrize("family", FAMILIES)
def test_half_precision_runs_and_gives_scores_like_the_full(
    made: Made, family: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = made(family).detect(FRAMES[0])
    monkeypatch.setattr("cartier.detectors.transformers._is_half", lambda model: True)
    half = made(family)
    assert half.name.endswith("half precision)")
    passes, seen = half._head.passes, []
    monkeypatch.setattr(half._head, "passes", lambda pixels: seen.extend(passes(pixels)) or seen)
    found = half.detect(FRAMES[0])
    assert {part.dtype for answer in seen for part in (answer.scores, answer.boxes)} == {torch.float32}
    assert found.scores[0] == pytest.approx(exact.scores[0], abs=0.2)  # rounding may let another query win


def test_name_views_and_sha256_say_what_was_asked(made: Made) -> None:
    owl, fewer, detr = made("owlv2", threshold=None), made("owlv2", vocabulary=["mug"]), made("detr", threshold=None)
    assert owl.name == "transformers owlv2 (counts from 0.25, 6 names)"
    assert detr.name == "transformers detr (counts from 0.7)"
    assert (owl.score_model.threshold, detr.score_model.threshold) == (0.25, 0.7)
    assert owl.sha256 != fewer.sha256
    assert owl.sha256 == made("owlv2").sha256
    assert made("detr").sha256 != made("yolos").sha256
    assert owl.notes == detr.notes == ()


def test_lvis_is_the_default_vocabulary(made: Made) -> None:
    detector = made("owlvit", vocabulary=None)
    assert "1203 names" in detector.name
    assert set(detector.detect(FRAMES[0]).labels) <= set(detector._head.names)


SIZES = [(480, 640), (640, 480), (97, 33), (200, 300)]


@pytest.mark.parametrize("family", FAMILIES)
def test_images_are_prepared_on_the_device_as_the_models_own_processor_prepares_them(made: Made, family: str) -> None:
    """Photograph-like images, smaller and larger than the input, one and many; at most rounding may differ."""
    images = made(family)._images
    for height, width in SIZES:
        y, x = np.mgrid[:height, :width] / 17
        view = (
            (127 + 90 * np.sin(x[None] + np.arange(3)[:, None, None]) * np.cos(y)).transpose(1, 2, 0).astype(np.uint8)
        )
        views = [view, view[::-1].copy(), np.zeros_like(view)]
        ours, theirs = images(views)["pixel_values"], images._theirs(views)["pixel_values"]
        assert ours.shape == theirs.shape and ours.dtype == theirs.dtype == torch.float32
        assert float((ours - theirs).abs().mean()) < 0.001 * float(theirs.max() - theirs.min())
    assert images.notes == []


@pytest.mark.parametrize(
    ("family", "unlike"),
    [
        ("d_fine", {"resample": 0}),
        ("d_fine", {"resample": 1}),
        ("owlvit", {"do_center_crop": True, "crop_size": {"height": 32, "width": 32}}),
        ("detr", {"pad_size": {"height": 200, "width": 200}}),
    ],
)
def test_a_processor_that_does_more_than_is_known_of_it_does_the_work_itself(
    folder: Callable[[str], Path], tmp_path: Path, family: str, unlike: dict[str, Any]
) -> None:
    import shutil

    shutil.copytree(folder(family), tmp_path / "model")
    told = tmp_path / "model" / "preprocessor_config.json"
    told.write_text(json.dumps(json.loads(told.read_text()) | unlike))
    words = {"vocabulary": NAMES} if family in ZERO_SHOT else {}
    images = make(tmp_path / "model", device="cpu", **words)._images
    views = [frame(number).rgb for number in (0, 3)]
    given, theirs = images(views), images._theirs(views)
    assert all(torch.equal(given[key], theirs[key]) for key in theirs)
    images(views)
    assert len(images.notes) == 1 and "100x70 px are prepared on the CPU, which is slow" in images.notes[0]


def test_a_processor_without_the_usual_settings_does_the_work_itself(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = made("d_fine")
    monkeypatch.delattr(detector._images._processor, "rescale_factor")
    theirs = {"pixel_values": torch.zeros(1, 3, 64, 64)}
    monkeypatch.setattr(detector._images, "_theirs", lambda images: theirs)
    assert detector._images([frame().rgb]) is theirs
    assert "are prepared on the CPU" in detector.notes[-1]


def test_a_batch_that_does_not_fit_in_memory_is_halved(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    detector = made("d_fine")
    views = [frame(number) for number in range(7)]
    alone, passes, asked = [detector.detect(view) for view in views], detector._head.passes, []

    def full(pixels: Any) -> Any:
        asked.append(len(pixels["pixel_values"]))
        if asked[-1] > 2:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 MiB")
        return passes(pixels)

    monkeypatch.setattr(detector._head, "passes", full)
    together = detector.detect_batch(views)
    assert [found.frame for found in together] == list(range(7))
    assert all(np.allclose(a.scores, b.scores, atol=1e-5) for a, b in zip(alone, together, strict=True))
    detector.detect_batch(views)
    assert max(asked[-3:]) <= 2, "what did not fit is not tried again"
    monkeypatch.setattr(detector._head, "passes", lambda pixels: full({"pixel_values": range(3)}))
    with pytest.raises(BackendError, match="failed on frame 0: CUDA out of memory"):
        detector.detect(views[0])
