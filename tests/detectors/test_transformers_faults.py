"""What is no model, no detector or no vocabulary: one line each, offline, and nothing of it is run."""

from __future__ import annotations

import importlib.util
import json
import pickle
import shutil
import socket
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_transformers import NAMES, TEXT_LIMIT, ZERO_SHOT, save

from cartier import plugins
from cartier.detectors.transformers import make
from cartier.errors import BackendError, CartierError, InputError, MissingExtra
from cartier.types import Camera, Frame

torch = pytest.importorskip("torch", reason="needs the extra [detect]: torch")
hf = pytest.importorskip("transformers", reason="needs the extra [detect]: transformers")

VIEW = Frame(7, 0.0, np.full((48, 64, 3), 90, np.uint8), None, np.eye(4), Camera(64, 48, 60.0, 60.0, 32.0, 24.0))


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)


@pytest.fixture(scope="session")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    root = tmp_path_factory.mktemp("models")
    return cache(lambda family: save(family, root / family))


@pytest.fixture
def copied(saved: Callable[[str], Path], tmp_path: Path) -> Callable[[str], Path]:
    return lambda family: Path(shutil.copytree(saved(family), tmp_path / family))


def refused(kind: type[CartierError], fault: str, model: Any, **options: Any) -> None:
    with pytest.raises(kind, match=fault) as error:
        make(model, **options)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("model", ["nobody/nothing", "nobody/nothing@v1", "no such model", "../..//x", "a\0b", "@"])
def test_a_model_that_is_not_there_is_refused(model: str) -> None:
    refused(InputError, "is neither a folder here nor a model", model)


def test_a_model_that_is_downloaded_already_is_found_offline_by_its_id(
    saved: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit = "0123456789abcdef0123456789abcdef01234567"
    (tmp_path / "models--somebody--tiny" / "refs").mkdir(parents=True)
    for name in ("main", "v1"):
        (tmp_path / "models--somebody--tiny" / "refs" / name).write_text(commit)
    shutil.copytree(saved("detr"), tmp_path / "models--somebody--tiny" / "snapshots" / commit)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    local = make(saved("detr"))
    for model in ("somebody/tiny", "somebody/tiny@v1", f"somebody/tiny@{commit}"):
        detector = make(model)
        assert detector.name == f"transformers {model} (counts from 0.7)"
        assert detector._loaded.source.where["revision"] == commit
        assert detector.sha256 == local.sha256
        assert detector.detect(VIEW).labels == local.detect(VIEW).labels
    refused(InputError, "is neither a folder here", "somebody/tiny@v2")


def test_without_a_network_a_hub_id_is_refused_at_once_with_the_way_out(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def no_address(*_: Any, **__: Any) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", False)
    monkeypatch.setattr("cartier.models.hub.getproxies", dict)
    monkeypatch.setattr("socket.getaddrinfo", no_address)
    refused(InputError, "no way to the hub: fetch it where there is a network", "nobody/nothing")
    assert "Retrying" not in "".join(capfd.readouterr())


def test_a_folder_that_is_not_there_or_holds_no_model_is_refused(tmp_path: Path) -> None:
    refused(InputError, "is no folder of a model", tmp_path / "missing")
    refused(InputError, "holds no config.json", tmp_path)
    refused(InputError, "holds no config.json", "")
    (tmp_path / "config.json").write_text("{ not json")
    refused(InputError, "its config.json cannot be read", tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "no_such_type"}')
    refused(InputError, "its config.json cannot be read", tmp_path)


def test_what_is_no_detector_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    refused(InputError, "is no detector that cartier runs: its type is bert, and those that run are owlv2, ", tmp_path)


def test_code_from_outside_is_never_run(copied: Callable[[str], Path]) -> None:
    folder = copied("detr")
    (folder / "evil.py").write_text("import pathlib; pathlib.Path(__file__).with_name('ran').touch()\n")
    config = json.loads((folder / "config.json").read_text())
    config |= {"auto_map": {"AutoConfig": "evil.C", "AutoModelForObjectDetection": "evil.M"}}
    (folder / "config.json").write_text(json.dumps(config))
    make(folder).detect(VIEW)
    (folder / "config.json").write_text(json.dumps(config | {"model_type": "unheard_of"}))
    refused(InputError, "cannot be read", folder)
    assert not (folder / "ran").exists()


def test_weights_are_safetensors_or_nothing(copied: Callable[[str], Path]) -> None:
    folder = copied("detr")
    (folder / "model.safetensors").unlink()
    (folder / "pytorch_model.bin").write_bytes(pickle.dumps({"a": 1}))
    refused(InputError, "detr cannot be loaded: .*safetensors", folder)
    (folder / "model.safetensors").write_bytes(b"\x00" * 100)
    refused(InputError, "detr cannot be loaded: ", folder)


def test_weights_that_are_not_a_whole_detectors_are_refused_instead_of_filled_at_random(
    copied: Callable[[str], Path],
) -> None:
    from safetensors.torch import load_file, save_file

    folder = copied("detr")
    weights = load_file(folder / "model.safetensors")
    head = [key for key in weights if key.startswith("class_labels_classifier")]
    save_file({k: v for k, v in weights.items() if k not in head}, folder / "model.safetensors", {"format": "pt"})
    refused(InputError, r"its weights lack 2 of the \d+ parameters .*class_labels_classifier", folder)
    config = json.loads((folder / "config.json").read_text())
    config["id2label"]["12"] = "one class more than the weights have"
    config["label2id"] = {label: int(number) for number, label in config["id2label"].items()}
    save_file(weights, folder / "model.safetensors", {"format": "pt"})
    (folder / "config.json").write_text(json.dumps(config))
    refused(InputError, "its weights lack 2 of .*class_labels_classifier", folder)


def test_a_folder_without_its_processor_is_refused(copied: Callable[[str], Path]) -> None:
    folder = copied("mm-grounding-dino")
    (folder / "tokenizer.json").unlink()
    (folder / "vocab.txt").unlink()
    refused(InputError, "its tokenizer has 5 tokens, but its text encoder 1030", folder)
    (folder / "preprocessor_config.json").unlink()
    refused(InputError, "mm-grounding-dino cannot be loaded: ", folder)


def test_a_folder_that_the_whole_processor_was_saved_in_is_read_too(copied: Callable[[str], Path]) -> None:
    folder = copied("grounding-dino")
    whole = make(folder, vocabulary=NAMES, threshold=0)._loaded
    (folder / "preprocessor_config.json").unlink()
    hf.GroundingDinoProcessor(whole.images, whole.tokenizer).save_pretrained(folder)
    assert not (folder / "preprocessor_config.json").exists()
    assert len(make(folder, vocabulary=NAMES, threshold=0).detect(VIEW))


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"threshold": -0.1}, "option threshold must be from 0 to 1"),
        ({"threshold": float("nan")}, "option threshold must be from 0 to 1"),
        ({"device": "abacus"}, "option device: torch cannot use 'abacus' here"),
        ({"device": "cuda:99"}, "option device: torch cannot use 'cuda:99' here"),
        ({"vocabulary": ["mug"]}, "knows a fixed set of names"),
    ],
)
def test_wrong_options_are_refused(saved: Callable[[str], Path], options: dict[str, Any], fault: str) -> None:
    refused(BackendError, fault, saved("detr"), **options)


def test_an_option_that_does_not_exist_is_refused(saved: Callable[[str], Path]) -> None:
    with pytest.raises(BackendError, match="has no option 'colour'; it has model, threshold, vocabulary, device"):
        plugins.make("detectors", "transformers", model=saved("detr"), colour="red")


@pytest.mark.parametrize("gone", ["torch", "transformers"])
def test_a_missing_library_is_an_extra_to_install(
    saved: Callable[[str], Path], gone: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = saved("yolos")
    monkeypatch.setitem(sys.modules, gone, None)
    with pytest.raises(MissingExtra, match=rf"needs the package '{gone}': pip install .*\[detect\]'"):
        plugins.make("detectors", "transformers", model=folder)


def test_a_backbone_of_a_library_that_is_not_there_is_told(copied: Callable[[str], Path]) -> None:
    if importlib.util.find_spec("timm"):
        pytest.skip("timm is installed: nothing is missing")
    folder = copied("detr")
    config = json.loads((folder / "config.json").read_text())
    config |= {"backbone_config": None, "use_timm_backbone": True, "backbone": "resnet50"}
    (folder / "config.json").write_text(json.dumps(config))
    refused(BackendError, "detr needs a package that is not installed: .*timm", folder)


def test_a_wrong_vocabulary_is_refused_before_the_model_is_loaded(
    copied: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = copied("owlv2")
    (folder / "model.safetensors").unlink()
    refused(InputError, r"missing\.txt is missing", folder, vocabulary=tmp_path / "missing.txt")
    refused(InputError, "holds 20000 names; at most", folder, vocabulary=[f"thing {i}" for i in range(20_000)])


@pytest.mark.parametrize("family", ZERO_SHOT)
def test_names_longer_than_the_text_encoder_reads_are_cut_and_said(saved: Callable[[str], Path], family: str) -> None:
    long = " ".join(["so"] * 60) + " long"
    detector = make(saved(family), vocabulary=["mug", long, "mug"], threshold=0, device="cpu")
    limit = {"owlv2": 48, "owlvit": 48, "omdet-turbo": 40}.get(family, TEXT_LIMIT - 3)
    assert f"1 names are cut to the text encoder's {limit} tokens" in "; ".join(detector.notes)
    assert 'vocabulary a list: 1 duplicates are merged ("mug")' in detector.notes
    assert set(detector.detect(VIEW).labels) <= {"mug", long}
    assert all("\n" not in line and len(line) < 300 for line in detector.notes)


def test_marks_that_end_a_name_in_a_prompt_are_left_out_of_it(saved: Callable[[str], Path]) -> None:
    plain, marked = (make(saved("grounding-dino"), vocabulary=[n, "bed"], threshold=0) for n in ("mug", "m.ug.?"))
    assert "m.ug.?" in marked._head.names
    assert len(plain.detect(VIEW)) and len(marked.detect(VIEW))
    refused(InputError, 'can read nothing of "日本"', saved("grounding-dino"), vocabulary=["mug", "日本"])
    refused(InputError, 'can read nothing of "..."', saved("grounding-dino"), vocabulary=["mug", "..."])


def test_a_model_without_names_says_so(copied: Callable[[str], Path]) -> None:
    folder = copied("yolos")
    config = json.loads((folder / "config.json").read_text())
    config["id2label"] = {str(number): f"LABEL_{number}" for number in range(12)}
    (folder / "config.json").write_text(json.dumps(config))
    assert make(folder).notes == ("yolos does not name its 12 classes: they are called label 0, label 1, …",)


@pytest.mark.parametrize("family", ["owlv2", "mm-grounding-dino", "rt_detr"])
def test_a_model_that_gives_nan_is_told_in_one_line(copied: Callable[[str], Path], family: str) -> None:
    from safetensors.torch import load_file, save_file

    folder = copied(family)
    weights = load_file(folder / "model.safetensors")
    save_file({k: v * torch.nan for k, v in weights.items()}, folder / "model.safetensors", {"format": "pt"})
    words = {"vocabulary": NAMES} if family in ZERO_SHOT else {}
    with pytest.raises(BackendError, match=r"gives NaN or infinity for frame 7|failed on frame 7") as error:
        make(folder, **words).detect(VIEW)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("size", [(1, 1), (1, 1000), (3, 2)])
@pytest.mark.parametrize("family", ["owlv2", "grounding-dino", "detr", "rt_detr"])
def test_frames_of_odd_sizes_give_detections_or_one_line(
    saved: Callable[[str], Path], family: str, size: tuple[int, int]
) -> None:
    view = Frame(
        1,
        0.0,
        np.zeros((*size, 3), np.uint8),
        None,
        np.eye(4),
        Camera(size[1], size[0], max(9.0, *size), max(9.0, *size), 0.0, 0.0),
    )
    words = {"vocabulary": ["mug"]} if family in ZERO_SHOT else {}
    try:
        found = make(saved(family), threshold=0, **words).detect(view)
    except BackendError as error:
        assert "failed on frame 1" in str(error) and "\n" not in str(error)
    else:
        assert found.frame == 1
