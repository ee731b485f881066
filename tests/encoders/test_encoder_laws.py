"""What every encoder owes the index: one space for images and words, and a map that finds words again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import BackendError
from cartier.testing import check_encoder
from synthetic import THINGS, TrueBoxes, walk


def test_the_embedded_encoder_has_words_only() -> None:
    encoder = plugins.make("encoders", "embedded")
    assert encoder.text_only and encoder.notes == ()
    assert encoder.text(["mug", "bed"]).shape == (2, 384) and encoder.text(["mug"]).dtype == np.float32
    with pytest.raises(BackendError, match="encodes no images"):
        encoder.image(walk()[0])


@pytest.mark.parametrize("kind", ["clip", "siglip"])
def test_encoders_of_images_obey_the_laws(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="the extra 'detect' (torch) is not installed")
    pytest.importorskip("transformers", reason="the extra 'detect' (transformers) is not installed")
    from tiny_clip import save_model

    model = save_model(tmp_path / "model", kind)
    check_encoder(lambda: plugins.make("encoders", "clip", model=str(model)))


@pytest.mark.parametrize("spec", [{}, {"model": "pixels"}])
def test_the_encoder_that_ships_inside_obeys_the_laws(spec: dict[str, str]) -> None:
    check_encoder(lambda: plugins.make("encoders", "embedded", **spec))


@pytest.mark.parametrize("kind", ["clip", "siglip"])
def test_a_map_of_image_features_is_saved_and_searched(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="the extra 'detect' (torch) is not installed")
    pytest.importorskip("transformers", reason="the extra 'detect' (transformers) is not installed")
    from tiny_clip import save_model

    spec = f"clip:{save_model(tmp_path / 'model', kind)}"
    index, recording = plugins.make("indexes", "vlmaps", encoder=spec), walk()
    for number in range(4):
        index.add(recording[number], TrueBoxes(THINGS).detect(recording[number]))
    again = plugins.make("indexes", "vlmaps")
    again.restore(index.state())
    assert again.encoder == index.encoder and "painted" not in again.encoder
    centres, cosines, _ = again.similarity("a phrase that nobody asked before")  # the saved home names its encoder
    assert len(centres) == len(cosines) > 50 and np.abs(cosines).max() <= 1 + 1e-5
    np.testing.assert_allclose(cosines, index.similarity("a phrase that nobody asked before")[1], atol=5e-3)
