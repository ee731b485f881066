"""A real server as the peer: ``transformers serve`` with a tiny vision model of random weights, which says garbage.

What must hold of any server: it takes the photographs that cartier sends, and garbage is no answer and no goal.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import openai
import pytest
from typer.testing import CliRunner

import cartier
from cartier import cli, plugins
from cartier.errors import ReasonerError
from cartier.home import Home
from cartier.home.looking import photographs_of
from cartier.types import CandidateView
from cartier.vision import prompt
from cartier.vision.check import check_model
from cartier.vision.crops import picture
from cartier.vision.look import question_about
from cartier.vision.permission import Look

torch = pytest.importorskip("torch", reason="needs the extra [detect]: torch")
hf = pytest.importorskip("transformers", minversion="5", reason="needs the extra [detect]: transformers")
for needed in ("accelerate", "fastapi", "uvicorn"):
    pytest.importorskip(needed, reason="transformers serve needs it")

SIDE, PATCH = 64, 16
IMAGE_TOKENS = (SIDE // PATCH) ** 2
MARKS = ["<pad>", "<end>", "<image>"]
TEMPLATE = """{% for turn in messages %}{% for part in turn.content %}\
{% if part.type == 'image' %}<image>{% else %}{{ part.text }}{% endif %}{% endfor %}{% endfor %}"""
UP_S = 90.0  # on a quiet machine it is up after 8 s, most of which are imports


@dataclass(frozen=True)
class Peer:
    """The server's URL, its model's name, and a home with photographs, in memory and in its folder."""

    url: str
    model: str
    home: Home
    folder: Path

    def says(self, content: list[dict[str, Any]]) -> tuple[str, int]:
        """The reply to one user turn, asked without cartier's client, and the tokens of its prompt."""
        turn: Any = {"role": "user", "content": content}
        with openai.OpenAI(base_url=self.url, api_key="none", max_retries=0) as client:
            said = client.chat.completions.create(model=self.model, messages=[turn], temperature=0, max_tokens=16)
        return said.choices[0].message.content, said.usage.prompt_tokens

    def pictures(self, label: str) -> list[CandidateView]:
        """Three pictures of the first object with a label."""
        thing, photos = next(each for each in self.home.objects if each.label == label), photographs_of(self.home)
        return [picture(thing, view, photos.rgb(view.frame), 400) for view in thing.views]

    def command(self, *words: str) -> list[str]:
        """The lines that a command prints."""
        done = CliRunner().invoke(cli.app, [*words, "--model", self.model], catch_exceptions=False)
        assert done.exit_code == 0 and "Traceback" not in done.output
        return done.stdout.splitlines()


def save_model(folder: Path) -> None:
    """A LLaVA of two layers that reads and writes bytes, as its own ``save_pretrained`` writes it."""
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers

    torch.manual_seed(3)
    words = [*MARKS, *sorted(pre_tokenizers.ByteLevel.alphabet())]
    letters = Tokenizer(models.BPE(vocab={word: number for number, word in enumerate(words)}, merges=[]))
    letters.pre_tokenizer, letters.decoder = pre_tokenizers.ByteLevel(add_prefix_space=False), decoders.ByteLevel()
    tokenizer = hf.PreTrainedTokenizerFast(
        tokenizer_object=letters, pad_token=MARKS[0], eos_token=MARKS[1], additional_special_tokens=MARKS[2:]
    )
    size = {"height": SIDE, "width": SIDE}
    processor = hf.LlavaProcessor(
        hf.CLIPImageProcessorPil(size=size, crop_size=size), tokenizer, patch_size=PATCH,
        vision_feature_select_strategy="default", num_additional_image_tokens=1, chat_template=TEMPLATE,
    )  # fmt: skip
    small = {"hidden_size": 32, "intermediate_size": 37, "num_hidden_layers": 2, "num_attention_heads": 4}
    text = hf.LlamaConfig(
        **small, vocab_size=len(words), max_position_embeddings=8192, pad_token_id=0, bos_token_id=None, eos_token_id=1
    )
    vision = hf.CLIPVisionConfig(**small, image_size=SIDE, patch_size=PATCH)
    model = hf.LlavaForConditionalGeneration(
        hf.LlavaConfig(vision_config=vision, text_config=text, image_token_index=2)
    )
    for weights in model.parameters():  # as they are made, a network's answer hardly depends on what it is asked
        if weights.dim() > 1:
            torch.nn.init.normal_(weights, std=weights[0].numel() ** -0.5)
    model.generation_config.exponential_decay_length_penalty = (12, 2.0)  # it would hardly ever end by itself
    model.save_pretrained(folder)
    processor.save_pretrained(folder)


@contextmanager
def server(model: Path, log: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """The process, which may still be starting, and its URL; it is gone afterwards."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    run = [sys.executable, "-m", "transformers.cli.transformers", "serve", str(model), "--device", "cpu"]
    offline = {"HF_HUB_OFFLINE": "1", "HF_HUB_DISABLE_UPDATE_CHECK": "1", "HF_HOME": str(log.parent)}
    run += ["--host", "127.0.0.1", "--port", port]
    with log.open("wb") as out, subprocess.Popen(run, stdout=out, stderr=out, env=os.environ | offline) as process:
        try:
            yield f"http://127.0.0.1:{port}", process
        finally:
            process.kill()  # it keeps nothing; its end is waited for


def wait_for(url: str, process: subprocess.Popen[bytes], log: Path) -> None:
    end = time.monotonic() + UP_S
    while process.poll() is None and time.monotonic() < end:
        try:
            urllib.request.urlopen(f"{url}/health", timeout=5).close()
            return
        except OSError:
            time.sleep(0.2)
    pytest.fail(f"the server did not start: {log.read_text(errors='replace')[-2000:]}")


@pytest.fixture(scope="module")
def peer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    folder = tmp_path_factory.mktemp("peer")
    save_model(folder / "model")
    with server(folder / "model", folder / "log") as (url, process):
        walk = plugins.make("worlds", "dollhouse", width=320, height=240).explore("studio", max_frames=4)
        truth = plugins.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        home = cartier.map_home(walk, truth)
        home.save(folder / "home")
        wait_for(url, process, folder / "log")
        yield Peer(f"{url}/v1", str(folder / "model"), home, folder / "home")
        assert process.poll() is None, "the server went down while it was asked"


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def test_server_takes_the_photographs_as_they_are_sent(peer: Peer) -> None:
    pictures, question = peer.pictures("dining table"), question_about("dining table", "clean")
    turn = prompt.request(question, pictures).messages[0]["content"]
    (_, with_images), (_, without) = peer.says(turn), peer.says(turn[-1:])
    assert len(turn) == 7 and with_images - without == 6 * IMAGE_TOKENS
    shown = [prompt.messages("What is this?", [each])[0]["content"] for each in (pictures[0], *peer.pictures("bed"))]
    assert len({peer.says(each)[0] for each in shown}) == len(shown)  # other pixels, another reply


@pytest.mark.parametrize("words", ["is the dining table clean?", "which chair is dirty?", "take me to a clean bed"])
def test_garbage_is_no_answer_and_no_goal(words: str, peer: Peer) -> None:
    model = cartier.make("vision", "openai", model=peer.model, base_url=peer.url)
    answer, unlooked = cartier.ask(peer.home, words, look=Look(model)), cartier.ask(peer.home, words)
    chosen, trace = answer.selection, answer.look
    assert trace is not None and trace.reply is not None and trace.pictures
    assert trace.reply.reply and not trace.reply.valid
    assert trace.reply.tokens > 2 * len(trace.pictures) * IMAGE_TOKENS  # each is a crop and a photograph
    assert (trace.verdict, trace.answer, trace.object_id, trace.why) == ("cannot_tell", None, None, prompt.INVALID)
    assert trace.view_from is None and f"the look did not help: {prompt.INVALID}" in answer.notes
    if words.startswith("take me"):  # where the list sends it without a look
        assert answer.goal is not None and unlooked.goal is not None
        assert (chosen.object_id, answer.goal.to_dict()) == (unlooked.selection.object_id, unlooked.goal.to_dict())
    else:
        assert (chosen.status, chosen.object_id, chosen.fact, answer.goal) == ("answered", None, None, None)
        assert chosen.text.startswith("I cannot tell by looking") and chosen.text.endswith(f": {prompt.INVALID}.")


def test_command_says_in_one_line_that_nothing_valid_came(peer: Peer) -> None:
    sent = ("--look", "auto", "--reasoner", "embedded", "--base-url", peer.url)
    first, *notes = peer.command("ask", str(peer.folder), "is the dining table clean?", *sent)
    assert first.startswith("answered: I cannot tell by looking at the dining table") and prompt.INVALID in first
    assert any("photographs were sent to" in note for note in notes)


def test_check_model_finds_that_it_does_not_see(peer: Peer) -> None:
    lines = [" ".join(line.split()) for line in peer.command("check-model", peer.url)]
    assert {"keeps a schema no, asked for as none of the forms", "sees no"} < set(lines)
    model = cartier.make("vision", "openai", model=peer.model, base_url=peer.url)
    answer = cartier.ask(peer.home, "is the dining table clean?", look=Look(model))
    assert answer.look is not None and answer.look.verdict == "not_asked" and model.calls == 0


def test_what_the_server_refuses_is_said_in_its_words(peer: Peer) -> None:
    with pytest.raises(ReasonerError, match=r"answered 400: [^\n]*Server is pinned to"):
        check_model(peer.url, "another")
