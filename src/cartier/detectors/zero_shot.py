"""How each family of transformers' detectors is asked: its names encoded once, then one image forward per frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from cartier.detectors.hub import Loaded
from cartier.detectors.vocabulary import shortened
from cartier.errors import InputError
from cartier.labels import display_name

TEXTS_AT_ONCE = 256
QUERIES = 900  # boxes per image and pass of the largest published models, but for OWL's one per patch
UNNAMED = "LABEL_0"  # what transformers calls the first class of a model that does not name its classes


@dataclass(frozen=True)
class Pass:
    """The answer of one pass for B images.

    ``scores`` (B, Q, n) are the probabilities of the n names whose numbers ``names`` holds, ``boxes`` (B, Q, 4) are
    cxcywh as shares of the image. Both are float32 tensors.
    """

    scores: Any
    boxes: Any
    names: Sequence[int]


class ClosedSet:
    """DETR and YOLOS (a softmax over the names and "nothing"), RT-DETR and D-FINE (a sigmoid per name)."""

    def __init__(self, loaded: Loaded, names: Sequence[str] = ()) -> None:
        self._model = loaded.model
        self._softmax = loaded.model.config.model_type in ("detr", "yolos")
        self.scores_per_image = loaded.model.config.num_labels * QUERIES
        given = loaded.model.config.id2label
        self.names = [self._name(given.get(number)) for number in range(loaded.model.config.num_labels)]
        self.notes = (
            [f"{loaded.source.name} does not name its {len(self.names)} classes: they are called label 0, label 1, …"]
            if given.get(0) == UNNAMED
            else []
        )

    @staticmethod
    def _name(label: str | None) -> str | None:
        return None if label in (None, "N/A") else display_name(label) or None  # DETR's gaps in COCO's numbers

    def passes(self, pixels: dict[str, Any]) -> Iterator[Pass]:
        out = self._model(**pixels)
        logits = out.logits.float()
        scores = logits.softmax(-1)[..., :-1] if self._softmax else logits.sigmoid()
        yield Pass(scores, out.pred_boxes.float(), range(scores.shape[-1]))


class Owl:
    """OWL-ViT (Minderer et al., ECCV 2022) and OWLv2 (NeurIPS 2023): each image patch is compared to each name."""

    def __init__(self, loaded: Loaded, names: Sequence[str]) -> None:
        self._model, self.names = loaded.model, list(names)
        self.scores_per_image = loaded.model.num_patches_height * loaded.model.num_patches_width * len(names)
        prompts = [f"a photo of a {name}" for name in names]
        batches, self.notes = _tokenised(loaded, prompts, names)
        texts = getattr(loaded.model, loaded.model.config.model_type)
        self._texts = _joined(texts.get_text_features(**batch).pooler_output for batch in batches)

    def passes(self, pixels: dict[str, Any]) -> Iterator[Pass]:
        map_ = self._model.image_embedder(pixels["pixel_values"])[0]
        features = map_.flatten(1, 2)
        logits, _ = self._model.class_predictor(features, self._texts.expand(len(features), -1, -1))
        yield Pass(logits.float().sigmoid(), self._model.box_predictor(features, map_).float(), range(len(self.names)))


class Grounding:
    """Grounding DINO (Liu et al., ECCV 2024), MM-Grounding-DINO and LLMDet: names packed into the fewest prompts.

    The image backbone runs once per image and the text backbone once per prompt ever; the fusion of both runs per
    prompt. A name's score is the mean over its tokens, as the authors' own evaluations have it.
    """

    def __init__(self, loaded: Loaded, names: Sequence[str]) -> None:
        self._model, self.names = loaded.model, list(names)
        tokens, self.notes = self._tokens(loaded, names)
        limit = _limit(loaded, loaded.model.config.max_text_len) - 2  # without [CLS] and [SEP]
        self._packs = packed([len(ids) + 1 for ids in tokens], limit)
        self._prompts = [self._prompt(loaded, [tokens[i] for i in pack]) for pack in self._packs]
        self.scores_per_image = QUERIES * loaded.model.config.max_text_len
        self._texts: list[Any] = [None] * len(self._packs)
        if len(self._packs) > 1:
            self.notes.append(f"{len(names)} names are asked for in {len(self._packs)} prompts per frame")

    @staticmethod
    def _tokens(loaded: Loaded, names: Sequence[str]) -> tuple[list[list[int]], list[str]]:
        """Token ids of each name, without the marks that end a name in a prompt, and cut to what a prompt holds."""
        tokenizer = loaded.tokenizer
        ends = tokenizer.convert_tokens_to_ids([".", "?"])
        given = tokenizer(list(names), add_special_tokens=False, verbose=False)["input_ids"]
        tokens = [[i for i in ids if i not in ends] for ids in given]
        empty = [n for n, ids in zip(names, tokens, strict=True) if not set(ids) - {tokenizer.unk_token_id}]
        if empty:
            raise InputError(
                f"the text encoder of {loaded.source.name} can read nothing of {shortened(empty)}: "
                "take it out of the vocabulary"
            )
        room = _limit(loaded, loaded.model.config.max_text_len) - 3
        long = [name for name, ids in zip(names, tokens, strict=True) if len(ids) > room]
        return [ids[:room] for ids in tokens], _cut_note(long, room)

    def _prompt(self, loaded: Loaded, tokens: Sequence[Sequence[int]]) -> tuple[Any, Any]:
        """One prompt "a mug. a bed." as input ids (1, T), and the matrix (T, n) that takes tokens' means per name."""
        import torch

        tokenizer, device = loaded.tokenizer, loaded.model.device
        stop = tokenizer.convert_tokens_to_ids(".")
        ids, means = [tokenizer.cls_token_id], torch.zeros(loaded.model.config.max_text_len, len(tokens))
        for column, name in enumerate(tokens):
            means[len(ids) : len(ids) + len(name), column] = 1 / len(name)
            ids += [*name, stop]
        return torch.tensor([[*ids, tokenizer.sep_token_id]], device=device), means.to(device)

    def passes(self, pixels: dict[str, Any]) -> Iterator[Pass]:
        import torch

        core = self._model.model
        count, _, *size = pixels["pixel_values"].shape
        mask = pixels.get("pixel_mask")
        if mask is None:
            mask = torch.ones((count, *size), dtype=torch.long, device=self._model.device)
        features, places = core.backbone(pixels["pixel_values"], mask)
        for number, (pack, (ids, means)) in enumerate(zip(self._packs, self._prompts, strict=True)):
            # the model appends to the list of places, so each pass gets its own
            with (
                _instead(core.backbone, lambda *_, **__: (features, list(places))),
                _instead(core.text_backbone, self._remembered(number, core.text_backbone.forward, count)),
            ):
                out = self._model(pixel_values=pixels["pixel_values"], pixel_mask=mask, input_ids=ids.repeat(count, 1))
            with torch.autocast(self._model.device.type, enabled=False):  # half precision would round the scores
                scores = out.logits.float().sigmoid() @ means
            yield Pass(scores, out.pred_boxes.float(), pack)

    def _remembered(self, number: int, encode: Callable[..., Any], count: int) -> Callable[..., Any]:
        """The text backbone's answer to one prompt, computed when first asked for, repeated for ``count`` images."""

        def text(*inputs: Any, **named: Any) -> Any:
            if self._texts[number] is None:
                self._texts[number] = encode(*(value[:1] for value in inputs), **named).last_hidden_state
            return SimpleNamespace(last_hidden_state=self._texts[number].expand(count, -1, -1))

        return text


class OmDetTurbo:
    """OmDet-Turbo (Zhao et al., 2024): all names in one pass, beside one task prompt that lists as many as it holds."""

    def __init__(self, loaded: Loaded, names: Sequence[str]) -> None:
        self._model, self.names = loaded.model, list(names)
        self.scores_per_image = QUERIES * len(names)
        language = loaded.model.language_backbone
        batches, self.notes = _tokenised(loaded, names, names)
        classes = _joined(language(batch["input_ids"], encode_type="class") for batch in batches)
        (task,), cut = _tokenised(loaded, [f"Detect {', '.join(names)}."], ["the task prompt"])
        words, mask = language(task["input_ids"], mask=task["attention_mask"], encode_type="task")
        self._language = classes[:, None], words, mask
        if cut:
            self.notes.append(f"the task prompt lists only the first of the {len(names)} names; all are asked for")

    def passes(self, pixels: dict[str, Any]) -> Iterator[Pass]:
        classes, words, mask = self._language
        count = len(pixels["pixel_values"])
        language = classes.expand(-1, count, -1), words.expand(-1, count, -1), mask.expand(count, -1)
        text = dict.fromkeys(("classes_input_ids", "classes_attention_mask", "tasks_input_ids", "tasks_attention_mask"))
        with _instead(self._model, lambda *_: language, "get_language_embedding"):
            out = self._model(pixel_values=pixels["pixel_values"], classes_structure=None, **text)
        scores = out.decoder_class_logits.float().sigmoid()
        yield Pass(scores, out.decoder_coord_logits.float(), range(len(self.names)))


def packed(sizes: Sequence[int], room: int) -> list[list[int]]:
    """Numbers of the items in each pack, none above ``room`` in sum: first fit, the largest first.

    At most 11/9 of the fewest packs (Johnson 1973); with names of a few tokens in prompts of 256 it is the fewest.
    """
    packs: list[list[int]] = []
    left: list[int] = []
    for item in sorted(range(len(sizes)), key=lambda i: -sizes[i]):
        at = next((k for k, free in enumerate(left) if free >= sizes[item]), None)
        if at is None:
            packs.append([])
            left.append(room)
            at = -1
        packs[at].append(item)
        left[at] -= sizes[item]
    return [sorted(pack) for pack in packs]


@contextmanager
def _instead(owner: Any, function: Callable[..., Any], method: str = "forward") -> Iterator[None]:
    """Let one module answer by another function for a while."""
    before = vars(owner).get(method)  # another library may have done the same
    setattr(owner, method, function)  # on the instance, where it hides the class's own
    try:
        yield
    finally:
        if before is None:
            delattr(owner, method)
        else:
            setattr(owner, method, before)


def _tokenised(loaded: Loaded, texts: Sequence[str], names: Sequence[str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Token ids and attention masks, some texts at a time, and a note on the names that were too long for it."""
    limit = _limit(loaded, loaded.model.config.text_config.max_position_embeddings)
    lengths = [len(ids) for ids in loaded.tokenizer(list(texts), verbose=False)["input_ids"]]
    batches = []
    for start in range(0, len(texts), TEXTS_AT_ONCE):
        some = list(texts[start : start + TEXTS_AT_ONCE])
        batch = loaded.tokenizer(some, padding="max_length", truncation=True, max_length=limit, return_tensors="pt")
        batches.append({key: batch[key].to(loaded.model.device) for key in ("input_ids", "attention_mask")})
    return batches, _cut_note([n for n, k in zip(names, lengths, strict=True) if k > limit], limit)


def _limit(loaded: Loaded, own: int) -> int:
    return min(own, int(loaded.tokenizer.model_max_length))


def _cut_note(names: Sequence[str], limit: int) -> list[str]:
    return [f"{len(names)} names are cut to the text encoder's {limit} tokens ({shortened(names)})"] if names else []


def _joined(parts: Iterator[Any]) -> Any:
    import torch

    return torch.cat(list(parts))
