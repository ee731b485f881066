"""Fit of the embedded reasoner's decision to answer, ask back or refuse: ``python tools/fit_decision.py REFERENCE``.

Writes understanding/decision.json: a multinomial logistic model over the numbers of ``outcome_classifier.Choice``.
REFERENCE as for train_scorer.py, which runs this, too. It is fitted on the voices in ``FITTED`` that no training of the
scorer saw, over lists of generated homes (none of the bench's), with what serves and without; and on what is asked for
by name, in those voices and in the scorer's own, and in frames, where it is listed and where not. Needs no torch.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scorer_requests import FRAMES, Homes, Request, read_requests

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

from cartier.understanding.card_vectors import ALIKE
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.needs import Needs
from cartier.understanding.outcome_classifier import FITTED as FILE
from cartier.understanding.outcome_classifier import OUTCOMES, Choice
from cartier_dollhouse import make

FITTED = ("hosts", "transcript", "wheels")  # styles that the scorer was not trained on, but this is
REPORTED = ("grumpy", "newcomer", "others_past")  # styles that only validate
DEVELOPMENT = ("night_kitchen", "sunday")  # by which weights and the alarms' threshold are chosen
HOMES = [str(number) for number in range(1001, 1013)]
LISTS, NAMED = 2, 1000  # lists in which something serves, for each request; names asked for
WEIGHTS = {"removed": 0.2, "nothing": 4.0, "listed": 0.5, "named": 0.5, "either": 0.2}
"""Against 1 for what is served. What is left of a list may still serve somebody, so that such lists count little."""
RIDGE = 0.003


class Case(NamedTuple):
    """The numbers of a decision, the statuses possible (4,), which of them is right, and how much that counts."""

    seen: np.ndarray
    possible: np.ndarray
    right: int
    weight: float
    sort: str


def _case(choice: Choice | None, request: Request, sort: str) -> Case | None:
    """Of a list without all that serves, near is right where it would be said of what was wanted."""
    if choice is None:
        return None
    best, second = choice.best.candidate.card, choice.rival.candidate.card if choice.rival else None
    if sort == "either":
        right = "clarify" if {best, second} == request.right else ""
    elif sort in ("served", "listed"):
        right = "found" if best in request.right else "clarify" if second in request.right else ""
    else:
        right = "likely_near" if choice.near and choice.missing.card in request.right else "not_found"
    if right not in choice.possible:
        return None
    mask = np.array([status in choice.possible for status in OUTCOMES])
    return Case(choice.features(), mask, OUTCOMES.index(right), WEIGHTS.get(sort, 1.0), sort)


def cases(needs: Needs, homes: Homes, requests: list[Request]) -> Iterator[Case | None]:
    """All that the decision is fitted on."""
    for request in (r for r in requests if r.kind != "several"):
        for number in range(LISTS + 1):
            serve = number < LISTS and request.kind != "nothing"
            rng = random.Random(f"{request.text}{number}")
            names = homes.sample(request, rng, serve)
            if number == 1:  # a small home
                right = [name for name in names if needs.deck.card_of(name) in request.right]
                names = list(dict.fromkeys([*right, *names[: rng.randint(3, 15)]]))
            sort = "served" if serve else "nothing" if request.kind == "nothing" else "removed"
            yield _case(needs.weigh(request.text, names), request, sort)
    yield from _named(needs, homes, random.Random(0))


def _named(needs: Needs, homes: Homes, rng: random.Random) -> Iterator[Case | None]:
    """Names asked for: one that is listed, one that is not, one and not another, and one or another."""
    deck, likeness = needs.deck, needs.scorer.knowledge.likeness
    for number in range(NAMED):
        card, other = (found[0] for found in rng.sample(homes.thor if number % 8 < 6 else homes.lvis, 2))
        name, also = (rng.choice(deck.cards[c].names) for c in (card, other))
        sort = ("listed", "named", "either", "listed", "listed")[number % 5]
        words = rng.choice(FRAMES["solo"]).format(y=f"{name} or the {also}" if sort == "either" else name)
        if number % 5 == 3:
            words = rng.choice(FRAMES["pairs"]).format(y=name, x=also)
        elif number % 5 == 4:
            words = f"{rng.choice(FRAMES['before']).format(x=also)} {words}"
        wanted = ((card,), (other,)) if sort == "either" else ((card,),)
        request = Request(words, "explicit", "", wanted, (other,))
        names = homes.sample(request, rng, sort != "named")
        if sort == "named":
            names = [n for n in names if likeness(card)[deck.card_of(n)] < ALIKE]
        yield _case(needs.weigh(words, names), request, sort)


def fit(data: list[Case]) -> dict[str, object]:
    """Weights (features, statuses) of the most probable model, with a ridge."""
    seen, possible = np.stack([c.seen for c in data]), np.stack([c.possible for c in data])
    right, weight = np.array([c.right for c in data]), np.array([c.weight for c in data])
    mean, spread = seen.mean(0), seen.std(0)
    z = np.c_[(seen - mean) / spread, np.ones(len(data))]

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        w = flat.reshape(z.shape[1], len(OUTCOMES))
        logits = np.where(possible, z @ w, -np.inf)
        shares = np.exp(logits - logits.max(1, keepdims=True))
        shares /= shares.sum(1, keepdims=True)
        wrong = shares - np.eye(len(OUTCOMES))[right]
        surprise = -(weight * np.log(shares[np.arange(len(data)), right])).sum()
        ridge = RIDGE * len(data) * w[:-1]
        slope = z.T @ (weight[:, None] * wrong)
        slope[:-1] += ridge
        return surprise + 0.5 * float((ridge * w[:-1]).sum()), slope.ravel()

    w = minimize(loss, np.zeros(z.shape[1] * len(OUTCOMES)), jac=True, method="L-BFGS-B").x.reshape(-1, len(OUTCOMES))
    kept = {"mean": mean, "spread": spread, "weights": w[:-1], "bias": w[-1]}
    return {name: np.round(values, 4).tolist() for name, values in kept.items()}


def write(needs: Needs, reference: Path) -> None:
    """Fit, and leave the model where the reasoner reads it."""
    homes, world = Homes(needs.deck, reference), make()
    homes.houses = [homes.named({candidate.label for candidate in world.objects(home)}) for home in HOMES]
    known = [r for r in read_requests(needs.deck) if r.style not in (*REPORTED, *DEVELOPMENT)]
    requests = [r for r in known if r.style in FITTED or r.kind == "explicit"]
    data = [case for case in cases(needs, homes, requests) if case is not None]
    lines = (f'"{name}": {json.dumps(values)}' for name, values in fit(data).items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(f"{len(data)} decisions: " + ", ".join(f"{s} {sum(OUTCOMES[c.right] == s for c in data)}" for s in OUTCOMES))


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("reference", type=Path, help="folder with thor_object_types.json and lvis_v1_categories.json")
    write(Needs(read_deck(SHIPPED)), parser.parse_args().reference)


if __name__ == "__main__":
    run_script(main)
