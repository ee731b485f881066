"""Training of the embedded reasoner's scorer and its report, as train_scorer.py starts them."""

from __future__ import annotations

import random
import time
from pathlib import Path

import fit_decision
import numpy as np
import torch
from _scorer_network import NOWHERE, Network, save
from fit_decision import DEVELOPMENT, FITTED, REPORTED
from scorer_report import Outcome, put, summary, table, write
from scorer_requests import Homes, Request, Sample, Variations, read_requests, written_needs

from cartier.reasoners.embedded import Embedded
from cartier.understanding.cards import SHIPPED, Deck, read_deck
from cartier.understanding.need_scorer import SHIPPED as PACKAGE
from cartier.understanding.need_scorer import Scorer

PASSES, BATCH, NAMES = 2, 32, 2000
RATE, HEAD_RATE, CARD_RATE, DECAY = 3e-4, 3e-3, 3e-5, 0.01
WARM_UP = 40  # steps
DOCS = Path(__file__).parents[1] / "docs/embedded.md"


class Trainer:
    """Trains networks on requests, their variations, and the uses of the cards."""

    def __init__(self, minilm: Path, deck: Deck, homes: Homes) -> None:
        from safetensors.numpy import load_file  # only who trains needs it

        raw = load_file(minilm / "model.safetensors")
        self.weights = {k.removeprefix("bert."): v for k, v in raw.items() if v.dtype.kind == "f"}
        self.deck, self.homes = deck, homes
        self.scorer = Scorer(self.deck, minilm)  # no vectors lie there, so the cards are as the encoder has them
        self.near = _near(self.scorer)

    def train(self, requests: list[Request], seed: int = 0) -> Network:
        """A network that learned from the requests, their variations, and the uses of the cards."""
        torch.manual_seed(seed)
        rng = random.Random(seed)
        network = Network(self.weights, self.scorer)
        network.train()
        body = [p for p in network.weights.values() if p.requires_grad]
        cards = list(network.cards.parameters())
        head = [p for name, p in network.named_parameters() if not name.startswith(("weights.", "cards."))]
        optimiser = torch.optim.AdamW([{"params": some} for some in (body, head, cards)], weight_decay=DECAY)
        passes = Variations(requests, self.deck, self.homes, self.near).passes(PASSES, NAMES, rng)
        batches = [batch for samples in passes for batch in _batches(samples, rng)]
        choice = Choice(self.scorer, self.homes, rng)
        losses: list[float] = []
        for step, batch in enumerate(batches):
            slope = min((step + 1) / WARM_UP, 1) * max(1 - step / len(batches), 0.02)
            for group, rate in zip(optimiser.param_groups, (RATE, HEAD_RATE, CARD_RATE), strict=True):
                group["lr"] = rate * slope
            loss = choice.loss(network, batch)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(body, 1.0)
            optimiser.step()
            losses.append(loss.item())
            if step % 100 == 99 or step == len(batches) - 1:
                print(f"step {step + 1} of {len(batches)}: loss {np.mean(losses[-100:]):.3f}", flush=True)
        return network.eval()


class Choice:
    """The loss: how surprising the right card is among those of a list drawn by chance, and nothing."""

    def __init__(self, scorer: Scorer, homes: Homes, rng: random.Random) -> None:
        self.count, self.rng = len(scorer.deck.cards), rng
        self.common, self.further = torch.zeros(self.count), torch.zeros(self.count)
        self.further[[card for card, _ in homes.lvis]] = 0.05
        self.common[[card for card, _ in homes.thor]] = 1.0

    def loss(self, network: Network, batch: list[Sample]) -> torch.Tensor:
        logits, nothing = network(batch)
        share = torch.where(torch.rand(len(batch), 1) < 0.6, 0.4, 0.15)
        listed = torch.rand(len(batch), self.count) < torch.maximum(self.common * share, self.further)
        right = torch.zeros(len(batch), self.count + 1, dtype=torch.bool)
        for row, sample in enumerate(batch):
            if sample.right:
                right[row, list(sample.right)] = True
                listed[row, self.rng.choice(sample.right)] = True
            else:
                right[row, -1] = True
            if sample.avoid and self.rng.random() < 0.8:
                listed[row, list(sample.avoid)] = True
            listed[row, list(sample.unlisted)] = False
        listed = torch.cat([listed, torch.ones(len(batch), 1, dtype=torch.bool)], 1)
        everything = torch.cat([logits, nothing[:, None]], 1)
        of_all = torch.logsumexp(everything.masked_fill(~listed, NOWHERE), 1)
        return (of_all - torch.logsumexp(everything.masked_fill(~(listed & right), NOWHERE), 1)).mean()


def _near(scorer: Scorer) -> list[list[int]]:
    """For each card the 24 that are most alike."""
    knowledge = scorer.knowledge
    means = np.add.reduceat(knowledge.uses, knowledge.use_starts)
    means = means / np.linalg.norm(means, axis=1, keepdims=True) + knowledge.names[knowledge.name_starts]
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    order: list[list[int]] = np.argsort(-(means @ means.T), axis=1)[:, 1:25].tolist()
    return order


def _batches(samples: list[Sample], rng: random.Random) -> list[list[Sample]]:
    """Samples of about the same length together, the batches in any order."""
    ordered = sorted(samples, key=lambda s: len(s.text) + rng.random() * 20)
    batches = [ordered[i : i + BATCH] for i in range(0, len(ordered), BATCH)]
    rng.shuffle(batches)
    return batches


def write_docs(outcomes: list[Outcome]) -> None:
    """Put the table between its marks into docs/embedded.md."""
    begin, end = "<!-- table -->", "<!-- end of table -->"
    text = DOCS.read_text(encoding="utf-8")
    before, after = text.split(begin)[0], text.split(end)[1]
    report = f"{table(outcomes)}\n\n{summary(outcomes)}"
    print(report)
    DOCS.write_text(f"{before}{begin}\n{report}\n{end}{after}", encoding="utf-8")


def train_and_report(reference: Path, minilm: Path | None, kept: Path | None) -> None:
    """Train, fit the decision and ship both where ``minilm`` is given; then put what ships to the test, for
    docs/embedded.md."""
    torch.set_num_threads(1)
    begin, deck = time.time(), read_deck(SHIPPED)
    homes, requests = Homes(deck, reference), read_requests(deck)
    if minilm:
        trainer = Trainer(minilm, deck, homes)
        learnt = [r for r in requests if r.style not in (*FITTED, *REPORTED, *DEVELOPMENT)]
        network = trainer.train([*learnt, *written_needs(deck)])
        save(network, PACKAGE)
        fit_decision.write(_shipped(deck), reference)
    outcomes = put(_shipped(deck), [r for r in requests if r.style in REPORTED], homes)
    if kept:
        write(outcomes, kept)
    write_docs(outcomes)
    print(f"{time.time() - begin:.0f} s")


def _shipped(deck: Deck) -> Embedded:
    return Embedded(deck, Scorer(deck, PACKAGE))
